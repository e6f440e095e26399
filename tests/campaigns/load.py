"""Many at a time, slow ones, and more than can be done."""
import base64
import contextlib
import hashlib
import json
import os
import re
import shutil
import socket
import subprocess
import threading
import time

from harness import (CAMERA, GABLE, ROOT, Gone, Service, Town, folder, free_port, in_parallel, percentile, png, upload, wait_all, wanted)


def uploads(figures, long):
    """U1, U2, U4: what is declared is checked, what is cut off leaves nothing, and memory stays bounded."""
    with folder() as path:
        service = Service(path / "data", "--workers", "1", environment={"GABLE_UPLOAD_MAX_BYTES": "300000000"})
        body = png(200, 200, 1)
        right = base64.b64encode(hashlib.sha256(body).digest()).decode()
        wrong = base64.b64encode(hashlib.sha256(b"x").digest()).decode()
        cases = [
            (201, body, {"Content-Type": "image/png", "Content-Digest": f"sha-256=:{right}:"}),
            (422, png(9, 9, 2), {"Content-Type": "image/png", "Content-Digest": f"sha-256=:{wrong}:"}),
            (415, png(9, 9, 3), {"Content-Type": "text/plain"}),
            (415, png(9, 9, 4), {"Content-Type": "image/jpeg"}),
            (413, None, {"Content-Type": "image/png", "Content-Length": "300000001"}),
            (415, b"no picture", {"Content-Type": "image/png"}),
        ]
        as_documented = 0
        for status, content, headers in cases:
            got = service.post("/api/v1/images", content, headers).status if content else head_alone(service, headers)
            as_documented += got == status
            if got != status:
                print(f"        {headers}: {got}, not {status}")
        figures.add("U2", f"{as_documented} of {len(cases)} wrong lengths, digests and types are answered as documented",
                    as_documented == len(cases))
        # U1: clients that are cut off at any byte
        whole, cut = png(300, 300, 6), 0
        for at in range(0, len(whole), len(whole) // (200 if long else 40)):
            with contextlib.suppress(OSError):
                client = socket.create_connection(("127.0.0.1", service.port))
                head = f"POST /api/v1/images HTTP/1.1\r\nHost: localhost\r\nContent-Type: image/png\r\nContent-Length: {len(whole)}\r\n\r\n"
                client.sendall(head.encode() + whole[:at])
                client.close()
                cut += 1
        time.sleep(1)
        left = len(os.listdir(path / "data/incoming"))
        kept = service.get("/api/v1/images").json()["items"]
        figures.add("U1", f"{cut} uploads cut off at different bytes: {left} left in incoming, {len(kept)} images (1 is right); kill -9 "
                          "in the middle: see D1", left == 0 and len(kept) == 1)
        # U4: large ones side by side
        size, count = (200_000_000, 64) if long else (20_000_000, 32)
        block, before, highest, codes = os.urandom(1 << 16), service.rss_mb(), [0.0], []

        def send(number):
            client = socket.create_connection(("127.0.0.1", service.port))
            head = f"POST /api/v1/images HTTP/1.1\r\nHost: localhost\r\nContent-Type: image/tiff\r\nContent-Length: {size}\r\n\r\n"
            client.sendall(head.encode() + b"II*\0" + number.to_bytes(8, "little"))
            sent = 12
            with contextlib.suppress(OSError):
                while sent < size:
                    piece = block[: min(len(block), size - sent)]
                    client.sendall(piece)
                    sent += len(piece)
            with contextlib.suppress(OSError):
                codes.append(int(client.recv(100).split()[1]))
            client.close()

        threads = in_parallel(count, send)
        while any(thread.is_alive() for thread in threads):
            highest[0] = max(highest[0], service.rss_mb())
            time.sleep(0.05)
        each = (highest[0] - before) / count
        figures.add("U4", f"{count} uploads of {size // 1_000_000} MB side by side: {each:.2f} MB of memory each; answered "
                          f"{sorted(set(codes))} (they are no TIFFs)", each <= 4 and len(codes) == count, mb_each=each)
        service.end()


def head_alone(service, headers):
    """The status of a request whose body is never sent."""
    client = socket.create_connection(("127.0.0.1", service.port), timeout=10)
    head = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    client.sendall(f"POST /api/v1/images HTTP/1.1\r\nHost: localhost\r\n{head}\r\n".encode())
    status = int(client.recv(100).split()[1])
    client.close()
    return status


def pinged(service, path, seconds, gap=0.005):
    """Times of answers, one after the other."""
    times, until = [], time.time() + seconds
    while time.time() < until:
        began = time.time()
        with contextlib.suppress(Gone):
            service.get(path)
            times.append(time.time() - began)
        time.sleep(gap)
    return times


def slow(figures, long):
    """O2: half-sent heads, dribbling bodies and clients that do not read are harmless to the others."""
    import resource
    resource.setrlimit(resource.RLIMIT_NOFILE, (resource.getrlimit(resource.RLIMIT_NOFILE)[1],) * 2)
    heads, bodies, readers = (2000, 2000, 200) if long else (500, 500, 50)
    with folder() as path:
        service = Service(path / "data", "--workers", "1", environment={"GABLE_CONNECTIONS_MAX": "8000"})
        service.post("/api/v1/cameras", CAMERA)
        calm = percentile(pinged(service, "/api/v1/cameras", 3), 0.99)
        clients = {"head": [], "body": [], "reader": []}
        for kind, count in (("head", heads), ("body", bodies), ("reader", readers)):
            for _ in range(count):
                client = socket.create_connection(("127.0.0.1", service.port))
                if kind == "head":
                    client.sendall(b"GET /api/v1/cameras HTTP/1.1\r\nHost: loc")
                elif kind == "body":
                    client.sendall(b"POST /api/v1/images HTTP/1.1\r\nHost: localhost\r\nContent-Type: image/png\r\nContent-Length: 100000\r\n\r\n\x89PNG")
                else:
                    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
                    client.sendall(b"GET /api/v1/openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * 20)
                clients[kind].append(client)
        began = time.time()
        beside = percentile(pinged(service, "/api/v1/cameras", 3), 0.99)
        descriptors = service.descriptors()
        closed = {}
        for kind, limit in (("head", 14), ("body", 36)):
            left = clients[kind]
            while left and time.time() - began < limit + 5:
                left = [client for client in left if not is_closed(client)]
                time.sleep(0.2)
            closed[kind] = (time.time() - began, len(left))
        service.end()
    figures.add("O2", f"{heads} half heads closed after {closed['head'][0]:.0f} s ({closed['head'][1]} left), {bodies} stalled bodies after "
                      f"{closed['body'][0]:.0f} s ({closed['body'][1]} left), {readers} that do not read; healthy p99 {1000 * calm:.1f} ms "
                      f"before, {1000 * beside:.1f} ms beside them; {descriptors} descriptors",
                closed["head"][1] == 0 and closed["body"][1] == 0 and beside <= max(2 * calm, 0.02))


def is_closed(client):
    client.setblocking(False)
    try:
        while True:
            if not client.recv(4096):
                return True
    except BlockingIOError:
        return False
    except OSError:
        return True


def overload(figures, long):
    """O1: ten times more than can be done is refused at once, and what is done is not less."""
    with folder() as path:
        town = Town(path)
        service = Service(path / "data", environment={"GABLE_QUEUE_MAX_JOBS": "8"})
        image = town.put(service)
        seconds = 60 if long else 12
        goodput, refusals, strange = {}, [], set()
        capacity = measured_capacity(service, town, image, 10)
        for load in (1, 2, 5, 10):
            accepted, until, gap = [], time.time() + seconds, 1 / (capacity * load)
            due = time.time()

            def one():
                began = time.time()
                answer = service.post("/api/v1/orientations", town.request(image))
                if answer.status == 202:
                    accepted.append(answer.json()["id"])
                elif answer.status in (429, 503) and answer.headers.get("Retry-After"):
                    refusals.append(time.time() - began)
                else:
                    strange.add(answer.status)

            began = time.time()
            while time.time() < until:
                threading.Thread(target=one, daemon=True).start()
                due += gap
                time.sleep(max(0.0, due - time.time()))
            time.sleep(1)
            ended = wait_all(service, accepted, 120)
            goodput[load] = len(ended) / (time.time() - began)
        service.end()
    peak = max(goodput.values())
    told = ", ".join(f"{load}x {rate:.2f}/s" for load, rate in goodput.items())
    figures.add("O1", f"done at {told}; at 10x {100 * goodput[10] / peak:.0f} % of the best; {len(refusals)} refused with Retry-After, "
                      f"p99 {1000 * percentile(refusals, 0.99):.0f} ms; other answers: {strange or 'none'}",
                goodput[10] >= 0.9 * peak and not strange and percentile(refusals, 0.99) <= 0.05, goodput=goodput)


def measured_capacity(service, town, image, count):
    began = time.time()
    ids = []
    while len(ids) < count:
        answer = service.post("/api/v1/orientations", town.request(image))
        if answer.status == 202:
            ids.append(answer.json()["id"])
        else:
            time.sleep(0.05)
    wait_all(service, ids, 120)
    return count / (time.time() - began)


def health(figures, long):
    """O5: /health answers at once while all cores orient."""
    with folder() as path:
        town = Town(path)
        service = Service(path / "data")
        image = town.put(service)
        ids = []
        for _ in range(200 if long else 40):
            ids.append(service.post("/api/v1/orientations", town.request(image)).json()["id"])
        times = pinged(service, "/health/live", 30 if long else 8)
        service.kill()
    figures.add("O5", f"/health/live while all cores orient: p50 {1000 * percentile(times, 0.5):.1f} ms, p99 "
                      f"{1000 * percentile(times, 0.99):.1f} ms of {len(times)}", percentile(times, 0.99) <= 0.02)


def reading(figures, long):
    """The rate of `GET` of a result beside that of an axum handler that does nothing, in turns in one run."""
    bare = ROOT / "target/release/examples/bare"
    if not shutil.which("wrk") or not bare.exists():
        print("        reading is left out: it needs wrk (Debian's package) and `cargo build --release --example bare`")
        return
    with folder() as path:
        town = Town(path)
        service = Service(path / "data", "--workers", "1")
        image = town.put(service)
        answer = service.post("/api/v1/orientations", town.request(image), {"Prefer": "wait=120"})
        (path / "answer.json").write_bytes(answer.body)
        # as a program that asks over the network would
        key = subprocess.run([GABLE, "key", "new", "--role", "reader", "--data", str(path / "data")], capture_output=True, text=True,
                             check=True).stdout.strip()
        port = free_port()
        other = subprocess.Popen([bare, f"127.0.0.1:{port}", str(path / "answer.json")])
        time.sleep(0.5)
        ours, theirs = [], []
        for _ in range(5 if long else 3):
            ours.append(wrk(f"http://127.0.0.1:{service.port}/api/v1/orientations/{answer.json()['id']}", key))
            theirs.append(wrk(f"http://127.0.0.1:{port}/"))
        other.kill()
        service.end()
    ratios = sorted(a / b for a, b in zip(ours, theirs))
    ratio = ratios[len(ratios) // 2]
    figures.add("—", f"GET of a result ({len(answer.body)} bytes): {max(ours):.0f}/s, bare axum handler {max(theirs):.0f}/s: {ratio:.2f} of it "
                     f"(median of {len(ratios)})", ratio >= 0.25, ratio=ratio)


def wrk(url, key=None):
    access = ["-H", f"Authorization: Bearer {key}"] if key else []
    told = subprocess.run(["wrk", "-t1", "-c16", "-d4s", *access, url], capture_output=True, text=True, check=True).stdout
    assert "Non-2xx" not in told, told
    return float(re.search(r"Requests/sec:\s+([\d.]+)", told).group(1))
