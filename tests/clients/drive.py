"""Goes the whole way by the generated client: camera, control points, image, orientation, verdict, lists, problems.

drive.py URL KEY FOLDER FILM IDS, where FOLDER is one that `gable simulate` wrote, and FILM one of `gable simulate --film`.
What it made is left in the service, and named in the file IDS for schemathesis.
"""

import json
import sys
import time
import uuid
from io import BytesIO
from pathlib import Path

from gable_client import AuthenticatedClient, Client
from gable_client.api.cameras import add_camera, delete_camera, list_cameras, show_camera
from gable_client.api.control_points import import_control_points, list_control_points
from gable_client.api.images import list_images, show_image, upload_image
from gable_client.api.interior_orientations import orient_interior, show_interior_orientation, show_mark, show_residuals
from gable_client.api.orientations import list_orientations, orient, show_orientation, show_overlay
from gable_client.api.service import is_live, is_ready
from gable_client.models import (
    ControlPointCollection, DigitalCameraRequest, FilmCameraRequest, Form, InteriorRequest, OrientationRequest, Problem,
)
from gable_client.types import File

url, key = sys.argv[1:3]
folder, film_folder, ids_file = map(Path, sys.argv[3:])
if key:
    client = AuthenticatedClient(base_url=url, token=key, timeout=330.0)
else:
    client = Client(base_url=url, timeout=330.0)


def told(step, fact=""):
    print(f"ok: {step}{': ' if fact else ''}{fact}")


def parsed(response, status, kind):
    """The body of an answer, if it has this status and the generated client has made it of this kind."""
    assert response.status_code == status, (response.status_code, response.content[:500])
    assert type(response.parsed).__name__ == kind, (type(response.parsed).__name__, response.content[:500])
    return response.parsed


def load(name, of=folder):
    return json.loads((of / name).read_text())


assert parsed(is_live.sync_detailed(client=client), 200, "Health").status == "live"
assert parsed(is_ready.sync_detailed(client=client), 200, "Health").status == "ready"
told("the service is ready")

# a name of its own for each run, so that it can be run again
name = f"clients-{uuid.uuid4()}"
body = DigitalCameraRequest.from_dict(load("camera.json") | {"name": name})
camera = parsed(add_camera.sync_detailed(client=client, body=body), 201, "DigitalCameraAnswer")
again = parsed(add_camera.sync_detailed(client=client, body=body), 200, "DigitalCameraAnswer")
assert camera.id == again.id and camera.name == name
found = parsed(show_camera.sync_detailed(camera.id, client=client), 200, "DigitalCameraAnswer")
assert found.principal_distance_px == body.principal_distance_px
told("a camera is added once", camera.id)

body.principal_distance_px = body.principal_distance_px + 1.0
problem = parsed(add_camera.sync_detailed(client=client, body=body), 409, "Problem")
assert problem.status == 409 and problem.title and problem.detail and problem.instance
told("another camera of that name is a conflict", problem.detail)

wrong = DigitalCameraRequest.from_dict(load("camera.json") | {"name": name + "-wrong", "principal_distance_px": -5.0})
problem = parsed(add_camera.sync_detailed(client=client, body=wrong), 422, "Problem")
assert any(error.pointer == "/principal_distance_px" for error in problem.errors), problem
told("a wrong field is a problem with its pointer", problem.errors[0].pointer)

crs = load("truth.json")["frame"]
points = load("control_points.geojson")
report = parsed(
    import_control_points.sync_detailed(client=client, body=ControlPointCollection.from_dict(points), crs=crs),
    200, "ImportAnswer",
)
assert report.imported + report.updated == len(points["features"]) and not report.rejected, report
told("control points", f"{report.imported} imported, {report.updated} updated")
problem = parsed(
    import_control_points.sync_detailed(client=client, body=ControlPointCollection.from_dict(points), crs="EPSG:1"),
    422, "Problem",
)
told("an unknown CRS is a problem", problem.detail[:60])

photograph = (folder / "photograph.png").read_bytes()


def form(content=photograph, kind="image/png"):
    return Form(file=File(payload=BytesIO(content), file_name="photograph", mime_type=kind))


response = upload_image.sync_detailed(client=client, body=form(), idempotency_key=str(uuid.uuid4()))
assert response.status_code in (200, 201), response.content
image = response.parsed
again = parsed(upload_image.sync_detailed(client=client, body=form()), 200, "ImageAnswer")
assert again.id == image.id
assert parsed(show_image.sync_detailed(image.id, client=client), 200, "ImageAnswer").size_bytes == len(photograph)
told("an image is stored once", image.id)

request = OrientationRequest.from_dict(
    {"image": str(image.id), "camera": name, "approximation": load("approximation.json")}
)
began = time.monotonic()
response = orient.sync_detailed(client=client, body=request, prefer="wait=60", idempotency_key="o-" + name)
assert response.status_code in (200, 202), (response.status_code, response.content[:500])
answer = response.parsed
while answer.status not in ("succeeded", "failed", "cancelled"):
    assert time.monotonic() - began < 600, "it has not ended in ten minutes"
    time.sleep(0.5)
    answer = parsed(show_orientation.sync_detailed(answer.id, client=client), 200, "OrientationAnswer")
assert answer.status == "succeeded", answer
verdict = answer.result.diagnosis.verdict
told("oriented", f"{verdict}, {answer.result.diagnosis.reasons[0].code}, {time.monotonic() - began:.1f} s")
truth = load("truth.json")
assert verdict == "green", "the simulated photograph is one that is oriented well"
found = answer.result.projection_centre.coordinates
told("projection centre", ", ".join(f"{value:.2f}" for value in found))

replayed = orient.sync_detailed(client=client, body=request, prefer="wait=60", idempotency_key="o-" + name)
assert replayed.parsed.id == answer.id, "the same key and body must be the same orientation"
told("the same request with the same key is answered by the same orientation")

overlay = show_overlay.sync_detailed(answer.id, client=client, width=400)
assert overlay.status_code == 200 and overlay.content[:3] == b"\xff\xd8\xff", overlay.content[:20]
told("the overlay is a JPEG", f"{len(overlay.content)} bytes")

problem = parsed(
    orient.sync_detailed(client=client, body=OrientationRequest.from_dict(request.to_dict() | {"camera": "?"})),
    422, "Problem",
)
assert any(error.pointer == "/camera" for error in problem.errors), problem
problem = parsed(show_orientation.sync_detailed(uuid.UUID(int=0), client=client), 404, "Problem")
told("what is not there is a problem", problem.title)


body = FilmCameraRequest.from_dict(load("camera.json", film_folder) | {"name": name + "-film"})
film_camera = parsed(add_camera.sync_detailed(client=client, body=body), 201, "FilmCameraAnswer")
scan = (film_folder / "photograph.tif").read_bytes()
response = upload_image.sync_detailed(client=client, body=form(scan, "image/tiff"))
assert response.status_code in (200, 201), response.content
body = InteriorRequest.from_dict({"image": str(response.parsed.id), "camera": name + "-film"})
interior = parsed(orient_interior.sync_detailed(client=client, body=body), 201, "InteriorOrientationAnswer")
assert interior.result.diagnosis.verdict == "green", interior.result.diagnosis
shown = parsed(show_interior_orientation.sync_detailed(interior.id, client=client), 200, "InteriorOrientationAnswer")
assert shown.result.to_dict() == interior.result.to_dict()
assert b"<svg" in show_residuals.sync_detailed(interior.id, client=client).content
mark = show_mark.sync_detailed(interior.id, interior.result.marks[0].name + ".png", client=client)
assert mark.status_code == 200 and mark.content[:4] == b"\x89PNG", mark.content[:300]
told("a scan of film", f"{interior.result.diagnosis.verdict}, {len(interior.result.marks)} marks")


def pages(list_, **wanted):
    """All items of a list, two by two."""
    items, cursor = [], None
    while True:
        more = {"cursor": cursor} if cursor else {}
        page = list_.sync_detailed(client=client, limit=2, **more, **wanted)
        assert page.status_code == 200 and len(page.parsed.items) <= 2, page.content[:300]
        items += page.parsed.items
        cursor = page.parsed.next_cursor
        if not cursor:
            return items
        assert len(page.parsed.items) == 2, "a page that is not the last is full"


for name_of, list_, wanted in [
    ("cameras", list_cameras, {}), ("images", list_images, {}), ("control points", list_control_points, {}),
    ("orientations", list_orientations, {"image": str(image.id)}),
]:
    items = pages(list_, **wanted)
    keys = [json.dumps(item.to_dict(), sort_keys=True, default=str) for item in items]
    assert len(set(keys)) == len(keys) > 0, f"{name_of}: an item came twice, or none came"
    told(f"list of {name_of}, two by two", f"{len(items)}")
problem = parsed(list_cameras.sync_detailed(client=client, cursor="no such page"), 422, "Problem")
told("a cursor of another service is a problem", problem.detail)

problem = parsed(delete_camera.sync_detailed(camera.id, client=client), 409, "Problem")
told("a camera in use stays", problem.detail)
if key:
    stranger = Client(base_url=url)
    problem = parsed(list_cameras.sync_detailed(client=stranger), 401, "Problem")
    assert isinstance(problem, Problem)
    told("without a key nothing is told", problem.detail)

point = list_control_points.sync(client=client, limit=1).items[0].to_dict()["properties"]["name"]
ids = {"CAMERA": camera.id, "IMAGE": image.id, "ORIENTATION": answer.id, "INTERIOR": interior.id, "CONTROL_POINT": point}
ids_file.write_text("".join(f"export {what}={value}\n" for what, value in ids.items()))
