/** Binary glTF, as somebody else's tool would write it. */

function chunk(kind: string, content: Buffer, fill: number): Buffer {
  const padded = Buffer.concat([content, Buffer.alloc((4 - (content.length % 4)) % 4, fill)]);
  const head = Buffer.alloc(8);
  head.writeUInt32LE(padded.length);
  head.write(kind, 4, "latin1");
  return Buffer.concat([head, padded]);
}

/** A document and its chunk BIN. */
export function glb(document: object, binary: Buffer): Buffer {
  const chunks = Buffer.concat([chunk("JSON", Buffer.from(JSON.stringify(document)), 0x20), chunk("BIN\0", binary, 0)]);
  const head = Buffer.alloc(12);
  head.write("glTF");
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(12 + chunks.length, 8);
  return Buffer.concat([head, chunks]);
}
