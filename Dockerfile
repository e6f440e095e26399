# syntax=docker/dockerfile:1
#   docker build -t gable .
#   docker run -p 8080:8080 -v gable:/data -e GABLE_BOOTSTRAP_KEY="$(openssl rand -base64 33)" --stop-timeout 30 gable
# The first key comes from GABLE_BOOTSTRAP_KEY; without any key the service refuses to listen to the network.

FROM rust:1.95-slim-bookworm AS build
WORKDIR /src
COPY Cargo.toml Cargo.lock ./
COPY .cargo .cargo
COPY migrations migrations
COPY src src
RUN --mount=type=cache,target=/usr/local/cargo/registry \
    --mount=type=cache,target=/src/target \
    cargo build --release --locked --bin gable && install target/release/gable /usr/local/bin/gable

FROM debian:bookworm-slim
# the certificates that webhooks and object stores are held against; and what `gable backup` wants for PostgreSQL
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates postgresql-client \
    && rm -rf /var/lib/apt/lists/*
RUN useradd --system --uid 10001 --no-create-home --shell /usr/sbin/nologin gable \
    && install --directory --owner gable --group gable /data
COPY --from=build /usr/local/bin/gable /usr/local/bin/gable
USER 10001
ENV GABLE_LISTEN=0.0.0.0:8080 \
    GABLE_DATA=/data \
    GABLE_LOG_FORMAT=json
VOLUME /data
EXPOSE 8080
# bash can talk to a socket by itself: nothing is installed for this
HEALTHCHECK --interval=10s --timeout=5s --start-period=20s --retries=3 CMD ["bash", "-c", \
    "exec 3<>/dev/tcp/127.0.0.1/8080 && printf 'GET /health/ready HTTP/1.1\\r\\nHost: localhost\\r\\nConnection: close\\r\\n\\r\\n' >&3 && read -r status <&3 && [[ $status == *' 200 '* ]]"]
ENTRYPOINT ["gable"]
CMD ["serve"]
