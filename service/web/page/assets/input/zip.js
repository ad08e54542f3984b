// @ts-check
/** Writes zip files whose members are stored without compression (PKWARE's APPNOTE 6.3.10, section 4.3). */

const VERSION = 20;
const UTF8 = 0x0800; // the flag of names in UTF-8
const JANUARY_1980 = 0x21; // the first date of zip, so that the same files make the same zip
const TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  for (let bit = 0; bit < 8; bit++) byte = byte & 1 ? 0xedb88320 ^ (byte >>> 1) : byte >>> 1;
  return byte;
});

/**
 * @param {{name: string, file: Blob}[]} members Names with `/` between folders.
 * @returns {Promise<Blob>}
 */
export async function writeZip(members) {
  /** @type {BlobPart[]} */
  const parts = [];
  /** @type {BlobPart[]} */
  const directory = [];
  let offset = 0, length = 0;
  for (const { name, file } of members) {
    const bytes = new TextEncoder().encode(name);
    const checksum = computeChecksum(new Uint8Array(await file.arrayBuffer()));
    const fields = [VERSION, UTF8, 0, 0, JANUARY_1980, [checksum], [file.size], [file.size], bytes.length, 0];
    const local = pack([[0x04034b50], ...fields]);
    const central = pack([[0x02014b50], VERSION, ...fields, 0, 0, 0, [0], [offset]]);
    parts.push(local, bytes, file);
    directory.push(central, bytes);
    offset += local.length + bytes.length + file.size;
    length += central.length + bytes.length;
  }
  const end = pack([[0x06054b50], 0, 0, members.length, members.length, [length], [offset], 0]);
  return new Blob([...parts, ...directory, end], { type: "application/zip" });
}

/**
 * Packs little-endian fields.
 * @param {(number | number[])[]} fields Numbers of 2 bytes, or of 4 bytes in brackets.
 */
function pack(fields) {
  return Uint8Array.from(
    fields.flatMap((field) => {
      const [value, size] = typeof field === "number" ? [field, 2] : [field[0], 4];
      return Array.from({ length: size }, (_, at) => (value >>> (8 * at)) & 0xff);
    }),
  );
}

/**
 * Computes the CRC-32.
 * @param {Uint8Array} bytes
 */
function computeChecksum(bytes) {
  let sum = 0xffffffff;
  for (const byte of bytes) sum = TABLE[(sum ^ byte) & 0xff] ^ (sum >>> 8);
  return ~sum >>> 0;
}
