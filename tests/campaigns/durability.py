"""What was acknowledged survives: kill -9, a full disk, and a restore from a backup taken while the service worked."""
import contextlib
import hashlib
import os
import random
import shutil
import subprocess
import threading
import time

from harness import (CAMERA, GABLE, Gone, Postgres, Service, folder, in_parallel, png, rows, upload, wait_all, wanted)


def kills(figures, long):
    """D1: uploads, jobs and cameras that got a 2xx are there after kill -9 at a random moment."""
    kill_writers(figures, 1000 if long else 40, None)
    with folder() as path:
        postgres = Postgres(path)
        try:
            kill_writers(figures, 200 if long else 10, postgres)
        finally:
            postgres.stop()


def kill_writers(figures, kills, postgres):
    acknowledged, lost, damaged, fault = {}, 0, 0, threading.Lock()
    with folder() as path:
        arguments = ["--database-url", postgres.url] if postgres else []
        seed = 0

        def write(service, stop, number):
            nonlocal seed
            while not stop.is_set():
                with fault:
                    seed += 1
                    mine = seed
                body = png(seed=mine)
                with contextlib.suppress(Gone):
                    answer = upload(service, body)
                    if answer.status in (200, 201):
                        image = answer.json()["id"]
                        acknowledged[f"/api/v1/images/{image}"] = hashlib.sha256(body).hexdigest()
                        answer = service.post("/api/v1/orientations", wanted(image))
                        if answer.status in (200, 202):
                            acknowledged[f"/api/v1/orientations/{answer.json()['id']}"] = None

        for _ in range(kills):
            service = Service(path / "data", "--workers", "1", *arguments)
            service.post("/api/v1/cameras", CAMERA)
            stop = threading.Event()
            threads = in_parallel(4, lambda n: write(service, stop, n))
            time.sleep(random.uniform(0.02, 0.12))
            service.kill()
            stop.set()
            for thread in threads:
                thread.join()
            if not postgres:
                damaged += rows(path / "data", "PRAGMA integrity_check") != [("ok",)]
        service = Service(path / "data", "--workers", "1", *arguments)
        for where, sha256 in acknowledged.items():
            answer = service.get(where)
            gone = answer.status != 200 or (sha256 and answer.json()["sha256"] != sha256)
            if sha256 and not gone:
                file = path / "data/images" / sha256
                gone = hashlib.sha256(file.read_bytes()).hexdigest() != sha256
            lost += bool(gone)
        service.end()
    where = "PostgreSQL" if postgres else "SQLite"
    figures.add("D1", f"{where}: {kills} kills -9, {len(acknowledged)} acknowledged, {lost} lost, {damaged} damaged databases",
                lost == 0 and damaged == 0, kills=kills, acknowledged=len(acknowledged), lost=lost)


def disk(figures, long):
    """D3: a full disk never corrupts and never lies. Needs root: a disk of 64 MB in memory is mounted."""
    if os.getuid() != 0:
        print("        disk is left out: it needs root to mount a small disk")
        return
    with folder() as path:
        data = path / "data"
        data.mkdir()
        if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(data)], check=False).returncode != 0:
            print("        disk is left out: a small disk cannot be mounted here")
            return
        try:
            service = Service(data, "--workers", "1", environment={"GABLE_DISK_RESERVE_BYTES": "0"})
            service.post("/api/v1/cameras", CAMERA)
            kept, statuses = {}, set()
            for seed in range(200):
                body = png(1000, 1000, seed)
                answer = upload(service, body)
                statuses.add(answer.status)
                if answer.status == 201:
                    kept[answer.json()["id"]] = hashlib.sha256(body).hexdigest()
                else:
                    break
            # the database too has no room left now
            filler = data / "filler"
            with contextlib.suppress(OSError), open(filler, "wb") as file:
                while True:
                    file.write(b"\0" * 65536)
                    file.flush()
            for number in range(300):
                answer = service.post("/api/v1/cameras", {**CAMERA, "name": f"{number}-{'x' * 180}"})
                statuses.add(answer.status)
                if answer.status not in (200, 201):
                    break
            alive = service.process.poll() is None
            reads = all(service.get(f"/api/v1/images/{image}").json()["sha256"] == sha for image, sha in kept.items())
            filler.unlink()
            began = time.time()
            while service.post("/api/v1/cameras", {**CAMERA, "name": "after"}).status not in (200, 201):
                time.sleep(0.1)
                if time.time() - began > 30:
                    break
            recovered = time.time() - began
            service.end()
            whole = rows(data, "PRAGMA integrity_check") == [("ok",)]
        finally:
            subprocess.run(["umount", "-l", str(data)], check=False)
    refused = statuses - {200, 201}
    figures.add("D3", f"full disk: refused with {sorted(refused)}, alive {alive}, {len(kept)} images readable {reads}, "
                      f"database whole {whole}, again after {recovered:.1f} s without a restart",
                refused and refused <= {507, 503} and alive and reads and whole and recovered <= 10)


def backup(figures, long):
    """D6: a backup while the service works, and the restore, compared by counts and hashes."""
    with folder() as path:
        service = Service(path / "data")
        service.post("/api/v1/cameras", CAMERA)
        stop, acknowledged = threading.Event(), []

        def write(number):
            seed = number * 1_000_000
            while not stop.is_set():
                seed += 1
                image = upload(service, png(seed=seed)).json()["id"]
                service.post("/api/v1/orientations", wanted(image))
                acknowledged.append(image)

        threads = in_parallel(2, write)
        time.sleep(20 if long else 3)
        before, began = list(acknowledged), time.time()
        subprocess.run([GABLE, "backup", "--to", str(path / "backup"), "--data", str(path / "data")], check=True,
                       stdout=subprocess.DEVNULL)
        took = time.time() - began
        stop.set()
        for thread in threads:
            thread.join()
        service.end()
        began = time.time()
        told = subprocess.run([GABLE, "restore", "--from", str(path / "backup"), "--data", str(path / "restored")],
                              check=True, capture_output=True, text=True).stdout.strip()
        restored_in = time.time() - began
        service = Service(path / "restored")
        missing = sum(service.get(f"/api/v1/images/{image}").status != 200 for image in before)
        orientations = [row[0] for row in rows(path / "restored", "SELECT lower(hex(id)) FROM orientations")]
        ended = wait_all(service, [f"{o[:8]}-{o[8:12]}-{o[12:16]}-{o[16:20]}-{o[20:]}" for o in orientations], 120)
        service.end()
    figures.add("D6", f"backup under load {took:.1f} s, restore {restored_in:.1f} s ({told}); of {len(before)} images from before "
                      f"it {missing} missing; {len(ended)} of {len(orientations)} orientations come to their end",
                missing == 0 and len(ended) == len(orientations), backup_s=took, restore_s=restored_in)
