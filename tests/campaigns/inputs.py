"""Bytes that are none of what they say."""
import contextlib
import random
import struct
import time
import zlib

from harness import CAMERA, Gone, Service, Town, folder, grey, in_parallel, wait_all, wanted


def bad_inputs(figures, long):
    """E2: bad pictures and bad bodies: no panic, no answer that is not meant, none slow."""
    count = 10_000 if long else 1000
    with folder() as path:
        town = Town(path)
        service = Service(path / "data", "--workers", "2", environment={"GABLE_BODY_IDLE_TIMEOUT_S": "5"})
        image = town.put(service)
        pictures = [(town.folder / "photograph.png").read_bytes()[:200_000], *seeds()]
        noise = random.Random(1)
        slow, strange, statuses, accepted, lock = [], [], {}, [], __import__("threading").Lock()

        def work(number):
            own = random.Random(number)
            for _ in range(count // 4):
                kind, body, headers, where = bad(own, pictures, image, town)
                began = time.time()
                try:
                    answer = service.post(where, body, headers)
                except Gone as error:
                    with lock:
                        strange.append((kind, str(error)))
                    continue
                took = time.time() - began
                with lock:
                    statuses[answer.status] = statuses.get(answer.status, 0) + 1
                    if answer.status >= 500 and answer.status not in (503, 507):
                        strange.append((kind, answer.status, answer.body[:200]))
                    if took > 2:
                        slow.append((kind, took))
                    if answer.status == 201 and where.endswith("images"):
                        accepted.append((answer.json()["id"], answer.json()["width_px"], answer.json()["height_px"]))

        for thread in in_parallel(4, work):
            thread.join()
        # what looked like a picture by its head is decoded now, in the worker processes
        ids = []
        for number, (id, width, height) in enumerate(accepted[: 400 if long else 60]):
            camera = {**CAMERA, "name": f"c{width}x{height}", "image_size_px": [width, height],
                      "principal_point_px": [width / 2, height / 2], "principal_distance_px": max(width, height)}
            service.post("/api/v1/cameras", camera)
            answer = service.post("/api/v1/orientations", {**town.request(id), "camera": camera["name"]})
            if answer.status == 202:
                ids.append(answer.json()["id"])
        ended = wait_all(service, ids, 600)
        internal = [o["error"] for o in ended.values() if o["status"] == "failed" and o["error"]["code"] in ("internal", "given_up")]
        log = (path / "data.log").read_text(errors="replace")
        panics = log.count("panicked") + log.count("worker process has ended")
        service.end()
    sent = sum(statuses.values()) + len(strange)
    told = ", ".join(f"{status}: {n}" for status, n in sorted(statuses.items()))
    figures.add("E2", f"{sent} bad inputs: {told}; {len(strange)} not meant, {len(slow)} slower than 2 s, {panics} panics or ended workers; "
                      f"{len(ids)} damaged pictures oriented: {len(ids) - len(ended)} without end, {len(internal)} by a fault of ours",
                sent == count and not strange and not slow and not panics and not internal and len(ended) == len(ids),
                strange=[str(s) for s in strange[:20]], slow=[str(s) for s in slow[:20]])
    for case in strange[:5] + slow[:5] + internal[:5]:
        print("       ", case)


def seeds():
    return [grey(64, 48), tiff(64, 48), jpeg_head(16000, 16000), tiff(60_000, 60_000, pixels=b"\0" * 100), grey(40_000, 40_000, rows=1)]


def tiff(width, height, pixels=None):
    """A small TIFF of one strip, whose pixels may be fewer than it says."""
    pixels = pixels if pixels is not None else bytes(x * 7 % 256 for x in range(width * height))
    entries = [(256, 4, width), (257, 4, height), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8), (277, 3, 1), (278, 4, height),
               (279, 4, len(pixels))]
    body = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in entries)
    return b"II*\0" + struct.pack("<I", 8 + len(pixels)) + pixels + struct.pack("<H", len(entries)) + body + b"\0" * 4


def jpeg_head(width, height):
    """The head of a JPEG that is much larger than its file."""
    frame = b"\xff\xc0" + struct.pack(">HBHHB", 11, 8, height, width, 1) + b"\1\x11\0"
    return b"\xff\xd8\xff\xe0\0\x10JFIF\0\1\1\0\0\1\0\1\0\0" + frame + b"\xff\xda\0\x08\1\1\0\0\x3f\0" + b"\0" * 300 + b"\xff\xd9"


def bad(own, pictures, image, town):
    """What is sent: a name for people, the body, its headers, and where to."""
    choice = own.random()
    if choice < 0.6:
        picture = bytearray(own.choice(pictures))
        change = own.choice(["cut", "flip", "head", "zero", "double", "tail", "polyglot"])
        if change == "cut":
            del picture[own.randrange(len(picture)):]
        elif change == "flip":
            for _ in range(own.randrange(1, 20)):
                picture[own.randrange(len(picture))] ^= 1 << own.randrange(8)
        elif change == "head":
            for _ in range(own.randrange(1, 8)):
                picture[own.randrange(min(200, len(picture)))] = own.choice([0, 255, 127, 128, own.randrange(256)])
        elif change == "zero":
            at = own.randrange(len(picture))
            picture[at:at + 500] = b"\0" * min(500, len(picture) - at)
        elif change == "double":
            picture = picture + picture
        elif change == "tail":
            picture = picture + own.randbytes(own.randrange(1, 3000))
        else:
            picture = bytearray(b"<html><script>alert(1)</script>") + picture
        kind = own.choice(["image/png", "image/jpeg", "image/tiff"])
        return f"picture {change}", bytes(picture), {"Content-Type": kind}, "/api/v1/images"
    if choice < 0.85:
        return "request", json_like(own, town.request(image)), {"Content-Type": "application/json"}, own.choice(
            ["/api/v1/orientations", "/api/v1/cameras", "/api/v1/references", "/api/v1/interior-orientations"])
    control = (town.folder / "control_points.geojson").read_bytes()[:5000]
    return "control", json_like(own, None, control), {"Content-Type": "application/geo+json"}, "/api/v1/control-points?crs=EPSG:25832"


def json_like(own, value, text=None):
    import json
    text = bytearray(text if text is not None else json.dumps(value).encode())
    for _ in range(own.randrange(1, 6)):
        at = own.randrange(len(text))
        text[at:at + own.randrange(0, 4)] = own.choice(
            [b"1e999", b"NaN", b"-", b"{", b"]", b'"', b"\\u0000", b"null", b"[[[[[[", b"1" * 400, b"\xff\xfe", b"", b"0.0000001"])
    return bytes(text) if own.random() < 0.97 else b"[" * 100_000
