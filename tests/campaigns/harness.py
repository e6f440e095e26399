"""What the campaigns have in common: a service of their own, ways to ask it, throw-away servers, and the table of figures."""
import contextlib
import http.client
import json
import os
import pathlib
import random
import shutil
import signal
import socket
import sqlite3
import struct
import subprocess
import tempfile
import threading
import time
import zlib

ROOT = pathlib.Path(__file__).resolve().parents[2]
GABLE = os.environ.get("GABLE_BINARY", str(ROOT / "target/release/gable"))


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def png(width=60, height=40, seed=0):
    """A grey picture whose pixels depend on `seed`."""
    noise = random.Random(seed)
    return packed(width, height, (noise.randbytes(width) for _ in range(height)))


def grey(width, height, rows=None):
    """A picture that is small as a file; with fewer `rows` than it says it is cut."""
    row = (bytes(range(256)) * (width // 256 + 1))[:width]
    return packed(width, height, (row for _ in range(height if rows is None else rows)))


def packed(width, height, rows):
    """A PNG of these rows of grey values."""
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    packer = zlib.compressobj(1)
    data = b"".join(packer.compress(b"\0" + row) for row in rows) + packer.flush()
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


class Gone(Exception):
    """The service did not answer: what was asked may or may not have been done."""


class Answer:
    def __init__(self, status, headers, body):
        self.status, self.headers, self.body = status, headers, body

    def json(self):
        return json.loads(self.body)


class Service:
    """A process of `gable` with its children; `gable work` if it says so."""

    def __init__(self, data, *arguments, command="serve", environment=None, ready=True):
        self.data, self.port = str(data), free_port()
        self.log = open(f"{self.data}.log", "ab")
        settings = {"GABLE_LOG": "warn", "GABLE_RATE_PER_S": "0", "RUST_BACKTRACE": "0", **(environment or {})}
        surroundings = {name: value for name, value in os.environ.items() if not name.startswith("GABLE_")}
        self.process = subprocess.Popen(
            [GABLE, command, "--listen", f"127.0.0.1:{self.port}", "--data", self.data, *arguments],
            env={**surroundings, **settings}, stderr=self.log, stdin=subprocess.DEVNULL, start_new_session=True)
        if ready:
            self.wait_ready()

    def wait_ready(self, patience=60):
        until = time.time() + patience
        while time.time() < until:
            with contextlib.suppress(Gone):
                if self.get("/health/ready", timeout=5).status == 200:
                    return
            if self.process.poll() is not None:
                break
            time.sleep(0.02)
        raise RuntimeError(f"the service is not ready; its log: {pathlib.Path(self.data + '.log').read_text()[-2000:]}")

    def ask(self, method, path, body=None, headers=None, timeout=60):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=timeout)
        try:
            if isinstance(body, (dict, list)):
                body, headers = json.dumps(body), {"Content-Type": "application/json", **(headers or {})}
            connection.request(method, path, body, headers or {})
            response = connection.getresponse()
            return Answer(response.status, response.headers, response.read())
        except (OSError, http.client.HTTPException) as error:
            raise Gone(str(error)) from error
        finally:
            connection.close()

    def get(self, path, **more):
        return self.ask("GET", path, **more)

    def post(self, path, body, headers=None, **more):
        return self.ask("POST", path, body, headers, **more)

    def children(self):
        """The worker processes."""
        path = pathlib.Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        # children belong to the thread that has begun them
        tasks = path.parent.parent
        found = []
        for task in tasks.iterdir() if tasks.exists() else []:
            with contextlib.suppress(OSError):
                found += [int(child) for child in (task / "children").read_text().split()]
        return found

    def kill(self):
        """As the end of a machine: the service and its workers at once."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def end(self, patience=40):
        """In order: the seconds that it took."""
        began = time.time()
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(patience)
        except subprocess.TimeoutExpired:
            self.kill()
            raise RuntimeError("the service does not end")
        return time.time() - began

    def rss_mb(self):
        text = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(text.split("VmRSS:")[1].split()[0]) / 1024

    def descriptors(self):
        return len(os.listdir(f"/proc/{self.process.pid}/fd"))


@contextlib.contextmanager
def folder():
    path = tempfile.mkdtemp(prefix="gable-campaign-")
    try:
        yield pathlib.Path(path)
    finally:
        shutil.rmtree(path, ignore_errors=True)


class Postgres:
    """A throw-away PostgreSQL with durable settings."""

    def __init__(self, path):
        self.bin = sorted(pathlib.Path("/usr/lib/postgresql").glob("*/bin"))[-1]
        self.folder, self.port = path / "postgres", free_port()
        self.folder.mkdir()
        if os.getuid() == 0:
            os.chmod(path, 0o755)
            shutil.chown(self.folder, "postgres", "postgres")
        self.tool("initdb", "--pgdata", f"{self.folder}/data", "--username", "gable", "--auth", "trust")
        self.start()
        self.tool("createdb", "-h", "127.0.0.1", "-p", str(self.port), "-U", "gable", "gable")
        self.url = f"postgres://gable@127.0.0.1:{self.port}/gable"
        subprocess.run([GABLE, "migrate", "--database-url", self.url, "--data", str(path / "migrating")], check=True,
                       stdout=subprocess.DEVNULL)

    def tool(self, name, *arguments, check=True):
        user = ["setpriv", "--reuid=postgres", "--regid=postgres", "--init-groups"] if os.getuid() == 0 else []
        return subprocess.run([*user, str(self.bin / name), *arguments], check=check, cwd="/", capture_output=True, text=True)

    def start(self):
        # its output must not keep our pipes open
        options = f"-p {self.port} -k {self.folder} -c listen_addresses=127.0.0.1 -c max_connections=200"
        self.tool("pg_ctl", "--pgdata", f"{self.folder}/data", "--log", f"{self.folder}/log", "--wait", "start", "--options", options)

    def stop(self, mode="immediate"):
        self.tool("pg_ctl", "--pgdata", f"{self.folder}/data", "--mode", mode, "stop", check=False)

    def value(self, sql):
        return self.tool("psql", "-h", "127.0.0.1", "-p", str(self.port), "-U", "gable", "-Atc", sql, "gable").stdout.strip()


def rows(data, sql):
    """What a query finds in the SQLite of a data folder."""
    with contextlib.closing(sqlite3.connect(f"file:{data}/gable.db?mode=ro", uri=True)) as connection:
        return connection.execute(sql).fetchall()


CAMERA = {"name": "small", "image_size_px": [60, 40], "principal_distance_px": 50.0, "principal_point_px": [30.0, 20.0]}


def upload(service, body, kind="image/png"):
    answer = service.post("/api/v1/images", body, {"Content-Type": kind})
    return answer


def wanted(image, camera="small", **more):
    """A request that comes to its end at once: there is no control where it looks."""
    position = {"crs": "EPSG:4979", "coordinates": [16.6, 52.7, 600.0]}
    return {"image": image, "camera": camera,
            "approximation": {"position": position, "sigma_position_m": [3, 3, 5], "kappa_deg": 0, "sigma_kappa_deg": 3}, **more}


class Town:
    """A simulated photograph with its control, whose orientation takes real work."""

    def __init__(self, path, seed=1):
        subprocess.run([GABLE, "simulate", "--out", str(path / "town"), "--seed", str(seed)], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.folder = next((path / "town").glob("seed-*"))
        self.frame = json.loads((self.folder / "truth.json").read_text())["frame"]
        self.camera = json.loads((self.folder / "camera.json").read_text())
        self.approximation = json.loads((self.folder / "approximation.json").read_text())

    def put(self, service):
        """Gives the service camera, control and image: the image's id."""
        import urllib.parse
        assert service.post("/api/v1/cameras", self.camera).status in (200, 201)
        crs = urllib.parse.quote(self.frame)
        control = (self.folder / "control_points.geojson").read_bytes()
        answer = service.post(f"/api/v1/control-points?crs={crs}", control, {"Content-Type": "application/geo+json"})
        assert answer.status == 200, answer.body
        return upload(service, (self.folder / "photograph.png").read_bytes()).json()["id"]

    def request(self, image):
        return {"image": image, "camera": self.camera["name"], "approximation": self.approximation}


def wait_all(service, ids, patience):
    """The orientations when all have ended, by id; those that have not are missing."""
    until, ended = time.time() + patience, {}
    while len(ended) < len(ids) and time.time() < until:
        for id in ids:
            if id not in ended:
                with contextlib.suppress(Gone):
                    answer = service.get(f"/api/v1/orientations/{id}")
                    if answer.status == 200 and answer.json()["status"] in ("succeeded", "failed", "cancelled"):
                        ended[id] = answer.json()
        time.sleep(0.05)
    return ended


def percentile(values, share):
    values = sorted(values)
    return values[min(len(values) - 1, int(share * len(values)))] if values else float("nan")


class Figures:
    """The table: a promise, what was measured, and whether it is held."""

    def __init__(self):
        self.rows = []

    def add(self, promise, told, held, **figures):
        self.rows.append({"promise": promise, "told": told, "held": bool(held), **figures})
        print(f"{'held' if held else 'BROKEN':<7} {promise:<4} {told}", flush=True)


def in_parallel(count, work):
    threads = [threading.Thread(target=work, args=(n,), daemon=True) for n in range(count)]
    for thread in threads:
        thread.start()
    return threads
