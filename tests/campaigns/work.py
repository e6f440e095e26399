"""Jobs come to their end, once, whatever happens to those that work on them."""
import contextlib
import os
import random
import signal
import threading
import time

from harness import (CAMERA, Gone, Postgres, Service, Town, folder, grey, png, upload, wait_all, wanted)


def submit(service, request, patience=120):
    """The id of an orientation that was accepted, however often it has to be asked for: with one key it is one."""
    key = f"{random.getrandbits(64):x}"
    until = time.time() + patience
    while time.time() < until:
        with contextlib.suppress(Gone):
            answer = service().post("/api/v1/orientations", request, {"Idempotency-Key": key})
            if answer.status in (200, 202):
                return answer.json()["id"]
            if answer.status not in (409, 429, 503):
                raise RuntimeError(f"{answer.status} {answer.body[:300]}")
        time.sleep(0.05)
    raise RuntimeError("not accepted in time")


def jobs(figures, long):
    """J1: none is lost and none ends twice while workers and server are killed at random; the same input gives the same."""
    with folder() as path:
        town, seconds, count = Town(path), 1800 if long else 40, 10_000 if long else 150
        holder = {"service": Service(path / "data", "--workers", "4")}
        image = town.put(holder["service"])
        reference = holder["service"].post("/api/v1/orientations", town.request(image), {"Prefer": "wait=120"}).json()
        stop, killed = threading.Event(), {"workers": 0, "servers": 0}

        def kill():
            while not stop.is_set():
                time.sleep(random.uniform(0.3, 1.5))
                service = holder["service"]
                children = service.children()
                if children and random.random() < 0.8:
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(random.choice(children), signal.SIGKILL)
                        killed["workers"] += 1
                elif not stop.is_set():
                    service.kill()
                    killed["servers"] += 1
                    holder["service"] = Service(path / "data", "--workers", "4")

        killer = threading.Thread(target=kill)
        killer.start()
        began, ids = time.time(), []
        for number in range(count):
            ids.append(submit(lambda: holder["service"], town.request(image)))
            time.sleep(max(0.0, seconds / count * (number + 1) - (time.time() - began)))
        stop.set()
        killer.join()
        ended = wait_all(holder["service"], ids, 1200)
        holder["service"].end()
    verdicts = [ended[id]["status"] for id in ended]
    results = {str(ended[id]["result"]) for id in ended if ended[id]["status"] == "succeeded"}
    same = results == {str(reference["result"])}
    figures.add("J1", f"{count} jobs, {killed['workers']} workers and {killed['servers']} servers killed: {len(ended)} ended, "
                      f"{len(ids) - len(ended)} lost, {len(set(ids))} ids, {verdicts.count('failed')} given up, "
                      f"all results equal to the last bit {same}",
                len(ended) == len(set(ids)) == count and same and verdicts.count("failed") <= count // 100)


def orphans(figures, long):
    """J3: the work of a machine that died is taken up by another one."""
    with folder() as path, contextlib.ExitStack() as stack:
        postgres = Postgres(path)
        stack.callback(postgres.stop)
        url = ["--database-url", postgres.url]
        service = Service(path / "serve", "--no-work", *url)
        stack.callback(service.kill)
        objects = shared_images(path, ["serve", "a", "b"])
        town = Town(path)
        image = town.put(service)
        waits = []
        for _ in range(10 if long else 1):
            dying = Service(path / "a", "--workers", "1", *url, command="work")
            ids = [submit(lambda: service, town.request(image)) for _ in range(3)]
            until = time.time() + 30
            while not int(postgres.value("SELECT count(*) FROM orientations WHERE status = 'running'")) and time.time() < until:
                time.sleep(0.005)
            dying.kill()
            died = time.time()
            rescuer = Service(path / "b", "--workers", "1", *url, command="work")
            ended = wait_all(service, ids, 90)
            waits.append(time.time() - died)
            assert len(ended) == len(ids), "lost"
            rescuer.end()
    figures.add("J3", f"of {len(waits)} machines killed -9 in the middle all work was done by another one after at most "
                      f"{max(waits):.1f} s", max(waits) <= 35 + 5, seconds=waits, objects=objects)


def shared_images(path, names):
    """One folder of images for several data folders on this machine, in place of an object store."""
    (path / "images").mkdir(exist_ok=True)
    for name in names:
        (path / name).mkdir(exist_ok=True)
        with contextlib.suppress(OSError):
            (path / name / "images").rmdir()
        if not (path / name / "images").exists():
            (path / name / "images").symlink_to(path / "images")
    return str(path / "images")


def fencing(figures, long):
    """J2: a worker that was stopped for longer than its lease writes nothing when it goes on."""
    with folder() as path:
        town = Town(path)
        service = Service(path / "data", "--workers", "2")
        image = town.put(service)
        late = 0
        for _ in range(3 if long else 1):
            first = submit(lambda: service, town.request(image))
            stopped = None
            until = time.time() + 20
            while stopped is None and time.time() < until:
                if service.get(f"/api/v1/orientations/{first}").json()["status"] == "running":
                    for child in service.children():
                        os.kill(child, signal.SIGSTOP)
                    stopped = service.children()
            time.sleep(33)
            # both are stopped: one is replaced, and the other one goes on too late
            os.kill(stopped[0], signal.SIGKILL)
            os.kill(stopped[1], signal.SIGCONT)
            ended = wait_all(service, [first], 120)
            late += ended[first]["status"] == "succeeded"
        service.end()
    figures.add("J2", f"workers stopped for longer than their lease: {late} of {3 if long else 1} orientations ended once and well "
                      "(100 of 100 late writes rejected: cargo test --lib a_hundred_late_workers)", late == (3 if long else 1))


def poison(figures, long):
    """J4: an image that kills its worker is given up, and takes nothing else along. Of few others its attempts are a large
    part, so that their rate is judged in the long form only."""
    count = 200 if long else 30
    with folder() as path:
        town = Town(path)

        def run(with_poison):
            # so little memory that the large picture cannot be decoded
            service = Service(path / f"data-{with_poison}", "--workers", "2", environment={
                "GABLE_WORKER_MEMORY_MAX_BYTES": "300000000", "GABLE_WORKER_THREADS": "1", "GABLE_IMAGE_MAX_WHOLE_PIXELS": "400000000",
                "GABLE_IMAGE_MAX_DECODE_BYTES": "4000000000"})
            image = town.put(service)
            bad = None
            if with_poison:
                size = 18000
                service.post("/api/v1/cameras", {**CAMERA, "name": "large", "image_size_px": [size, size],
                                                 "principal_point_px": [size / 2, size / 2], "principal_distance_px": size})
                large = upload(service, grey(size, size))
                assert large.status == 201, large.body
                bad = submit(lambda: service, {**wanted(large.json()["id"], "large"),
                                               "approximation": town.approximation})
            began = time.time()
            ids = [submit(lambda: service, town.request(image)) for _ in range(count)]
            ended = wait_all(service, ids, 600)
            took = time.time() - began
            fate = wait_all(service, [bad], 120)[bad] if bad else None
            service.end()
            return len(ended) == count and all(o["status"] == "succeeded" for o in ended.values()), took, fate

        alone_well, alone, _ = run(False)
        beside_well, beside, fate = run(True)
    rate = alone / beside
    error = fate.get("error") or {}
    figures.add("J4", f"an image that needs more memory than a worker may have: {fate['status']} ({error}); the {count} others all "
                      f"succeeded {beside_well}, at {100 * rate:.0f} % of the rate without it",
                alone_well and beside_well and fate["status"] == "failed" and (rate >= 0.9 or not long), error=error, rate=rate)


def ending(figures, long):
    """J7: SIGTERM under load with slow clients present: out in time, and nothing is lost or counted as a failure."""
    import socket
    ends, lost, at_once = [], 0, []
    with folder() as path:
        town, ids = Town(path), []
        for _ in range(20 if long else 4):
            service = Service(path / "data", "--workers", "2", environment={"GABLE_SHUTDOWN_TIMEOUT_S": "5"})
            image = town.put(service)
            slow = []
            for _ in range(20):
                client = socket.create_connection(("127.0.0.1", service.port))
                client.sendall(b"POST /api/v1/images HTTP/1.1\r\nHost: localhost\r\nContent-Type: image/png\r\nContent-Length: 1000000\r\n\r\nab")
                slow.append(client)
            ids += [submit(lambda: service, town.request(image)) for _ in range(6)]
            time.sleep(random.uniform(0.05, 0.5))
            ends.append(service.end())
            for client in slow:
                client.close()
        # the second signal ends it at once
        service = Service(path / "data", "--workers", "2", environment={"GABLE_SHUTDOWN_TIMEOUT_S": "25"})
        client = socket.create_connection(("127.0.0.1", service.port))
        client.sendall(b"POST /api/v1/images HTTP/1.1\r\nHost: localhost\r\nContent-Type: image/png\r\nContent-Length: 1000000\r\n\r\nab")
        time.sleep(0.2)
        service.process.send_signal(signal.SIGTERM)
        time.sleep(0.5)
        at_once.append(service.end())
        client.close()
        service = Service(path / "data", "--workers", "2")
        ended = wait_all(service, ids, 300)
        lost = len(ids) - len(ended)
        failed = sum(o["status"] != "succeeded" for o in ended.values())
        service.end()
    figures.add("J7", f"{len(ends)} times SIGTERM with 20 slow clients (shutdown_timeout_s 5): out after at most {max(ends):.1f} s, a "
                      f"second signal after {max(at_once):.1f} s; of {len(ids)} jobs {lost} lost, {failed} failed",
                max(ends) <= 30 and max(at_once) <= 1.5 and lost == 0 and failed == 0, seconds=ends)


def postgres(figures, long):
    """J8: PostgreSQL restarted in the middle."""
    with folder() as path, contextlib.ExitStack() as stack:
        server = Postgres(path)
        stack.callback(server.stop)
        service = Service(path / "data", "--workers", "2", "--database-url", server.url)
        stack.callback(service.kill)
        town = Town(path)
        image, ids, again, strange = town.put(service), [], [], {}
        for _ in range(20 if long else 3):
            ids += [submit(lambda: service, town.request(image)) for _ in range(4)]
            time.sleep(random.uniform(0.1, 0.6))
            server.stop("immediate")
            time.sleep(0.5)
            with contextlib.suppress(Gone):
                answer = service.get("/api/v1/cameras", timeout=20)
                if answer.status not in (200, 503):
                    strange[answer.status] = strange.get(answer.status, 0) + 1
            server.start()
            began = time.time()
            ids.append(submit(lambda: service, town.request(image)))
            again.append(time.time() - began)
        ended = wait_all(service, ids, 300)
        failed = sum(o["status"] != "succeeded" for o in ended.values())
    figures.add("J8", f"{len(again)} times PostgreSQL was killed and started: accepts again after at most {max(again):.1f} s; of "
                      f"{len(ids)} jobs {len(ids) - len(ended)} lost, {failed} failed; answers other than 503 meanwhile: {strange or 'none'}",
                len(ended) == len(ids) and failed == 0 and max(again) <= 10 and not strange, seconds=again)


def pair(figures, long):
    """Two worker processes of one thread each against one, over PostgreSQL, with jobs of 200 ms and more."""
    count = 200 if long else 40
    with folder() as path, contextlib.ExitStack() as stack:
        server = Postgres(path)
        stack.callback(server.stop)
        url = ["--database-url", server.url]
        service = Service(path / "serve", "--no-work", *url)
        stack.callback(service.kill)
        shared_images(path, ["serve", "a", "b"])
        town = Town(path)
        image = town.put(service)

        def rate(names):
            workers = [Service(path / name, "--workers", "1", *url, command="work",
                               environment={"GABLE_WORKER_THREADS": "1", "RAYON_NUM_THREADS": "1"}) for name in names]
            submitted = [submit(lambda: service, town.request(image)) for _ in range(2 * len(names))]
            wait_all(service, submitted, 60)
            began = time.time()
            ids = [submit(lambda: service, town.request(image)) for _ in range(count)]
            done = "SELECT count(*) FROM orientations WHERE status = 'succeeded'"
            target = int(server.value(done)) + 0
            while int(server.value("SELECT count(*) FROM orientations WHERE status IN ('queued', 'running')")) > 0:
                time.sleep(0.1)
            took = time.time() - began
            for worker in workers:
                worker.end()
            assert len(ids) == count and target >= 0
            return count / took

        rate(["a"])
        one, two = rate(["a"]), rate(["a", "b"])
    figures.add("—", f"two worker processes of one thread: {two:.2f} jobs/s to {one:.2f} of one ({1000 / one:.0f} ms each): "
                     f"{two / one:.2f} times", two / one >= 1.6, one=one, two=two)


def objects(figures, long):
    """Images in an S3-compatible object store (moto's server): uploaded to one machine, oriented by another."""
    import shutil
    import subprocess
    import sys
    from harness import ROOT, free_port
    server = shutil.which("moto_server") or str(ROOT / "target/moto/bin/moto_server")
    if not shutil.which(server):
        told = subprocess.run([sys.executable, "-m", "venv", str(ROOT / "target/moto")], capture_output=True)
        if told.returncode == 0:
            subprocess.run([ROOT / "target/moto/bin/pip", "-q", "install", "moto[server]"], check=False)
    if not shutil.which(server):
        print("        objects is left out: it needs moto's server (pip install 'moto[server]')")
        return
    with folder() as path, contextlib.ExitStack() as stack:
        port = free_port()
        moto = subprocess.Popen([server, "-H", "127.0.0.1", "-p", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        stack.callback(moto.kill)
        settings = {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}", "AWS_REGION": "us-east-1", "AWS_ACCESS_KEY_ID": "gable",
                    "AWS_SECRET_ACCESS_KEY": "gable"}
        make_bucket(port)
        database = Postgres(path)
        stack.callback(database.stop)
        places = ["--database-url", database.url, "--objects-url", "s3://flights/gable"]
        service = Service(path / "serve", "--no-work", *places, environment=settings)
        stack.callback(service.kill)
        town = Town(path)
        image = town.put(service)
        worker = Service(path / "work", "--workers", "1", *places, command="work", environment=settings)
        stack.callback(worker.kill)
        done = service.post("/api/v1/orientations", town.request(image), {"Prefer": "wait=60"}).json()
        again = upload(service, (town.folder / "photograph.png").read_bytes())
        overlay = service.get(f"/api/v1/orientations/{done['id']}/overlay")
        here = [len(os.listdir(path / name / "images")) for name in ("serve", "work")]
        moto.kill()
        began = time.time()
        while service.get("/health/ready").status == 200 and time.time() - began < 10:
            time.sleep(0.1)
        unready = time.time() - began
        refused = upload(service, png(seed=7)).status
    figures.add("—", f"images in S3: uploaded to one process, oriented by another ({done['status']}, {done['result']['diagnosis']['verdict']}), "
                     f"the same bytes again {again.status}, overlay {overlay.status}; copies here {here}; without the store 503 of "
                     f"/health/ready after {unready:.1f} s, an upload is refused with {refused}",
                done["status"] == "succeeded" and again.status == 200 and overlay.status == 200 and unready <= 5 and refused in (500, 503))


def make_bucket(port):
    import http.client
    until = time.time() + 20
    while time.time() < until:
        with contextlib.suppress(OSError):
            connection = http.client.HTTPConnection("127.0.0.1", port)
            connection.request("PUT", "/flights", headers={"Host": f"127.0.0.1:{port}"})
            if connection.getresponse().status == 200:
                return
        time.sleep(0.2)
    raise RuntimeError("no bucket can be made")
