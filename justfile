# What is done here day by day; `just` (https://just.systems) lists it. All of it works without `just` too.

bench := env("GABLE_BENCH", "../shared/bench")

[private]
default:
    @just --list

# simulate a town, orient its photograph, compare with the truth, and serve
demo *arguments:
    cargo run --release -- demo {{arguments}}

# all tests
test:
    cargo test --release

# the pages in a headless Chromium; `just pages screenshots` writes pictures of them
pages *what:
    cargo build --release
    tests/e2e/run {{what}}

# what .ci/run asks before the tests
check:
    cargo fmt --check
    cargo clippy --release --all-targets --locked -- -D warnings

# licences, advisories, sources (needs cargo-deny)
deny:
    cargo deny --locked check

# renew the contract's copy in the repository
openapi:
    cargo run --release --quiet -- openapi > target/openapi.json
    mv target/openapi.json openapi/gable.json

# ours against the Python peers, row by row (`just bench F1 F9` for some; needs Python 3.11 and the network once)
bench *rows:
    test -e target/peers/bin/python || benches/peers/install
    GABLE_BENCH="{{bench}}" cargo bench -- {{rows}}

# train the classifier that is shipped, from simulated images alone (some hours; goes on where it was stopped)
train-shipped:
    cargo build --release
    target/release/gable simulate --mixture poor --seed 100001 --images 2000 --out target/study-poor
    target/release/gable simulate --mixture good --seed 100001 --images 2000 --out target/study-good
    target/release/gable simulate --mixture wide --seed 100001 --images 300 --out target/study-wide
    target/release/gable train target/study-good target/study-poor --not-trained-on target/study-wide --out src/classifiers/shipped

# try to get a wrong orientation accepted
hostile images="10000":
    cargo build --release
    target/release/gable simulate --mixture hostile --images {{images}} --out target/study-hostile

# hold all files of deploy/ against their tools; with the URL of a service (and a key) its figures too
deploy-check *arguments:
    deploy/check {{arguments}}

# feed the parsers what strangers might send (libFuzzer), so many seconds each
fuzz seconds="60" *targets:
    fuzz/run {{seconds}} {{targets}}

# drive a service that runs by a generated client, and by schemathesis
clients url key="" examples="100":
    tests/clients/run "{{url}}" "{{key}}" "{{examples}}"

# hold the running service against its promises of reliability (`just campaigns --long` before a release)
campaigns *arguments:
    cargo build --release --bin gable --example bare
    tests/campaigns/run {{arguments}}

# the tests of the store and of the service over PostgreSQL
test-postgres:
    tests/with-postgres cargo test --release --lib -- --skip simulation:: store:: control:: jobs:: http:: webhooks::
    tests/with-postgres cargo test --release --test http

# orient the real images of all datasets, with all approximations, and compare with their references
bench-real:
    #!/usr/bin/env bash
    set -euo pipefail
    cargo build --release
    for dataset in boruszyn_wire boruszyn caliterra; do
        # the two of boruszyn describe the same buildings: each gets a data folder of its own
        data=$(mktemp -d)
        target/release/gable serve --listen 127.0.0.1:8099 --data "$data" 2> "$data/log" & service=$!
        trap 'kill $service; rm -rf "$data"' EXIT
        until curl --fail --silent --output /dev/null http://127.0.0.1:8099/health/ready; do
            kill -0 $service || { cat "$data/log"; exit 1; }
            sleep 0.2
        done
        for approximation in attitude nadir position; do
            echo "== $dataset, $approximation"
            {{bench}}/evaluate --url http://127.0.0.1:8099 --approximation $approximation {{bench}}/$dataset
        done
        trap - EXIT
        kill $service; wait $service || true; rm -rf "$data"
    done
