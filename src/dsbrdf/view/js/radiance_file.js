// Reading of Radiance's .hdr images (Ward, "Real pixels", Graphics Gems II, 1991).

/** The file is no whole image of this kind; the message is for people. */
export class RadianceFileError extends Error {}

function readHeader(bytes) {
  const end = bytes.findIndex((byte, i) => byte === 10 && bytes[i + 1] === 10);
  const text = new TextDecoder("latin1").decode(bytes.subarray(0, Math.max(end, 0)));
  if (!text.startsWith("#?"))
    throw new RadianceFileError("not a Radiance picture: it does not begin with '#?'.");
  if (!text.includes("FORMAT=32-bit_rle_rgbe"))
    throw new RadianceFileError("only the format 32-bit_rle_rgbe is read.");
  const lineEnd = bytes.indexOf(10, end + 2);
  const line = new TextDecoder("latin1").decode(bytes.subarray(end + 2, lineEnd));
  const size = /^-Y (\d+) \+X (\d+)$/.exec(line.trim());
  if (!size)
    throw new RadianceFileError(`expected a size like '-Y 512 +X 1024', got '${line.slice(0, 40)}'.`);
  return { height: Number(size[1]), width: Number(size[2]), start: lineEnd + 1 };
}

/** One row of run lengths, each component by itself; returns where the next begins. */
function readRow(bytes, start, row, width) {
  let at = start + 4;
  for (let component = 0; component < 4; component++) {
    for (let x = 0; x < width;) {
      const count = bytes[at++];
      const isRun = count > 128;
      const length = isRun ? count - 128 : count;
      if (!length || x + length > width) throw new RadianceFileError("the file is damaged or cut short.");
      for (let i = 0; i < length; i++, x++) row[4 * x + component] = bytes[isRun ? at : at + i];
      at += isRun ? 1 : length;
    }
  }
  return at;
}

/** Linear rgb of a file's bytes: {width, height, data}. */
export function readRadianceFile(bytes) {
  const { width, height, start } = readHeader(bytes);
  const data = new Float32Array(3 * width * height);
  const row = new Uint8Array(4 * width);
  let at = start;
  for (let y = 0; y < height; y++) {
    const packed = bytes[at] === 2 && bytes[at + 1] === 2 && bytes[at + 2] * 256 + bytes[at + 3] === width;
    if (packed) at = readRow(bytes, at, row, width);
    else {
      row.set(bytes.subarray(at, at + 4 * width));
      at += 4 * width;
    }
    if (at > bytes.length) throw new RadianceFileError("the file is cut short.");
    for (let x = 0; x < width; x++) {
      const exponent = row[4 * x + 3];
      const scale = exponent ? 2 ** (exponent - 136) : 0;
      for (let c = 0; c < 3; c++) data[3 * (y * width + x) + c] = row[4 * x + c] * scale;
    }
  }
  return { width, height, data };
}
