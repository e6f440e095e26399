"""What openapi-python-client could not make of the document: each must be known, with its reason."""

import re
import sys
from pathlib import Path

KNOWN = {
    # the client has no stream of lines as a body; the labelled set can be sent by any other HTTP client
    ("POST /api/v1/classifiers", "Unsupported content type text/plain"),
    # it sends a file as a form, and the bare body by any other HTTP client
    ("POST /api/v1/images", "Unsupported content type application/octet-stream"),
    # of a flight's list it sends GeoJSON; tables and text by any other HTTP client, or `gable block post`
    ("POST /api/v1/blocks", "Unsupported content type text/csv"),
    ("POST /api/v1/blocks", "Unsupported content type text/plain"),
    # of control points it sends GeoJSON and CityJSON; the others by any other HTTP client, or `gable import`
    ("POST /api/v1/control-points", "Unsupported content type application/city+json-seq"),
    ("POST /api/v1/control-points", "Unsupported content type application/geopackage+sqlite3"),
    ("POST /api/v1/control-points", "Unsupported content type application/gml+xml"),
    # tus has clients of its own
    ("POST /api/v1/uploads", "Unsupported content type application/offset+octet-stream"),
    ("PATCH /api/v1/uploads/{id}", "Unsupported content type application/offset+octet-stream"),
}

text = Path(sys.argv[1]).read_text()
found = set(re.findall(r"^(?:WARNING|ERROR) parsing (\S+ \S+) within .*?\.\n+(.*)$", text, re.MULTILINE))
if "ERROR" in text:
    sys.exit(text)
if new := found - KNOWN:
    sys.exit("\n".join(f"the generator leaves out: {where}: {what}" for where, what in sorted(new)))
print(f"a client with all operations; left out, as known: {len(found)} kinds of body")
