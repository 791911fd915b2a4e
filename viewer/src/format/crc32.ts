/** CRC-32 as in zip and PNG, eight bytes at a time. */

const TABLES = tables();
/** Whether the machine is little-endian. */
const LITTLE = new Uint8Array(Uint32Array.of(1).buffer)[0] === 1;

function tables(): Uint32Array[] {
  const first = new Uint32Array(256);
  for (let byte = 0; byte < 256; byte++) {
    let sum = byte;
    for (let bit = 0; bit < 8; bit++) sum = sum & 1 ? (sum >>> 1) ^ 0xedb88320 : sum >>> 1;
    first[byte] = sum;
  }
  const all = [first];
  for (let i = 1; i < 8; i++) {
    const before = all[i - 1];
    all.push(first.map((_, byte) => (before[byte] >>> 8) ^ first[before[byte] & 255]));
  }
  return all;
}

/** The checksum of `bytes`; `before` is the checksum of the bytes before them. */
export function crc32(bytes: Uint8Array, before = 0): number {
  const [t0, t1, t2, t3, t4, t5, t6, t7] = TABLES;
  let sum = ~before;
  let i = 0;
  // Chunks are aligned in their file; two words are faster to read than eight bytes.
  if (LITTLE && bytes.byteOffset % 4 === 0) {
    const words = new Int32Array(bytes.buffer, bytes.byteOffset, 2 * Math.floor(bytes.length / 8));
    for (let word = 0; word < words.length; word += 2) {
      const [low, high] = [sum ^ words[word], words[word + 1]];
      sum =
        t7[low & 255] ^ t6[(low >>> 8) & 255] ^ t5[(low >>> 16) & 255] ^ t4[low >>> 24] ^
        t3[high & 255] ^ t2[(high >>> 8) & 255] ^ t1[(high >>> 16) & 255] ^ t0[high >>> 24];
    }
    i = 4 * words.length;
  }
  for (const end = bytes.length - 7; i < end; i += 8) {
    const low = sum ^ (bytes[i] | (bytes[i + 1] << 8) | (bytes[i + 2] << 16) | (bytes[i + 3] << 24));
    sum =
      t7[low & 255] ^ t6[(low >>> 8) & 255] ^ t5[(low >>> 16) & 255] ^ t4[low >>> 24] ^
      t3[bytes[i + 4]] ^ t2[bytes[i + 5]] ^ t1[bytes[i + 6]] ^ t0[bytes[i + 7]];
  }
  for (; i < bytes.length; i++) sum = (sum >>> 8) ^ t0[(sum ^ bytes[i]) & 255];
  return ~sum >>> 0;
}
