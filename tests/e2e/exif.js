// A position in a JPEG, as a drone writes it.

function rational(value) {
  const bytes = Buffer.alloc(8);
  bytes.writeUInt32BE(Math.round(value * 1e6), 0);
  bytes.writeUInt32BE(1_000_000, 4);
  return bytes;
}

function sexagesimal(degrees) {
  const minutes = (Math.abs(degrees) % 1) * 60;
  return Buffer.concat([Math.floor(Math.abs(degrees)), Math.floor(minutes), (minutes % 1) * 60].map(rational));
}

// an entry of a directory: tag, type, count, and its value or where that is
function entry(tag, type, count, value) {
  const bytes = Buffer.alloc(12);
  bytes.writeUInt16BE(tag, 0);
  bytes.writeUInt16BE(type, 2);
  bytes.writeUInt32BE(count, 4);
  if (typeof value === 'number') bytes.writeUInt32BE(value, 8);
  else value.copy(bytes, 8);
  return bytes;
}

const ASCII = 2;
const LONG = 4;
const RATIONAL = 5;

function directory(entries) {
  const count = Buffer.alloc(2);
  count.writeUInt16BE(entries.length);
  return Buffer.concat([count, ...entries, Buffer.alloc(4)]);
}

/** The JPEG with longitude, latitude (degrees) and altitude (metres) in its EXIF. */
export function withPosition(jpeg, longitude, latitude, altitude) {
  const gpsAt = 8 + 2 + 12 + 4;
  const valuesAt = gpsAt + 2 + 5 * 12 + 4;
  const gps = directory([
    entry(1, ASCII, 2, Buffer.from(latitude < 0 ? 'S\0' : 'N\0')), entry(2, RATIONAL, 3, valuesAt),
    entry(3, ASCII, 2, Buffer.from(longitude < 0 ? 'W\0' : 'E\0')), entry(4, RATIONAL, 3, valuesAt + 24),
    entry(6, RATIONAL, 1, valuesAt + 48),
  ]);
  const header = Buffer.from([0x4d, 0x4d, 0, 42, 0, 0, 0, 8]);
  const tiff = Buffer.concat([header, directory([entry(0x8825, LONG, 1, gpsAt)]), gps, sexagesimal(latitude), sexagesimal(longitude), rational(altitude)]);
  const body = Buffer.concat([Buffer.from('Exif\0\0'), tiff]);
  const marker = Buffer.from([0xff, 0xe1, 0, 0]);
  marker.writeUInt16BE(body.length + 2, 2);
  return Buffer.concat([jpeg.subarray(0, 2), marker, body, jpeg.subarray(2)]);
}
