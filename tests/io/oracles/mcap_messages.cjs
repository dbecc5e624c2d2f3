// The messages of an MCAP file as its authors' library reads or writes them (npm: @mcap/core,
// @mcap/support).
//
//     mcap_messages.cjs read FILE LIST [stream]      by the index, or without it
//     mcap_messages.cjs write LIST FILE none|zstd chunks|plain
//
// LIST is as in rosbag_messages.py.
const fs = require('fs');
const {McapIndexedReader, McapStreamReader, McapWriter} = require('@mcap/core');
const {loadDecompressHandlers} = require('@mcap/support');

function readList(path) {
  const data = fs.readFileSync(path);
  const messages = [];
  let at = 0;
  const part = () => {
    const size = data.readUInt32LE(at);
    at += 4 + size;
    return data.subarray(at - size, at);
  };
  while (at < data.length) {
    const stamp = data.readBigUInt64LE(at);
    at += 8;
    messages.push({stamp, topic: part().toString(), type: part().toString(), bytes: part()});
  }
  return messages;
}

function listed({stamp, topic, type, bytes}) {
  const head = Buffer.alloc(8);
  head.writeBigUInt64LE(stamp);
  const parts = [head];
  for (const part of [Buffer.from(topic), Buffer.from(type), Buffer.from(bytes)]) {
    const size = Buffer.alloc(4);
    size.writeUInt32LE(part.length);
    parts.push(size, part);
  }
  return Buffer.concat(parts);
}

async function read(path, stream) {
  const bytes = new Uint8Array(fs.readFileSync(path));
  const decompressHandlers = await loadDecompressHandlers();
  const found = [];
  const schemas = new Map(), channels = new Map();
  const take = (message) => {
    const channel = channels.get(message.channelId);
    const type = schemas.get(channel.schemaId).name;
    found.push(listed({stamp: message.logTime, topic: channel.topic, type, bytes: message.data}));
  };
  if (stream) {
    const reader = new McapStreamReader({decompressHandlers, validateCrcs: true});
    reader.append(bytes);
    for (let record; (record = reader.nextRecord());) {
      if (record.type === 'Schema') schemas.set(record.id, record);
      if (record.type === 'Channel') channels.set(record.id, record);
      if (record.type === 'Message') take(record);
    }
    if (!reader.done()) throw new Error('the file does not end as it should');
    return found;
  }
  const readable = {
    size: async () => BigInt(bytes.length),
    read: async (offset, length) => bytes.slice(Number(offset), Number(offset + length)),
  };
  const reader = await McapIndexedReader.Initialize({readable, decompressHandlers});
  for (const [id, schema] of reader.schemasById) schemas.set(id, schema);
  for (const [id, channel] of reader.channelsById) channels.set(id, channel);
  for await (const message of reader.readMessages()) take(message);
  return found;
}

async function write(path, messages, compression, chunks) {
  const zstd = require('@foxglove/wasm-zstd');
  await zstd.isLoaded;
  const file = fs.openSync(path, 'w');
  let position = 0n;
  const writable = {
    position: () => position,
    write: async (bytes) => {
      fs.writeSync(file, bytes);
      position += BigInt(bytes.length);
    },
  };
  const writer = new McapWriter({
    writable,
    useChunks: chunks,
    chunkSize: 10000,
    compressChunk: compression === 'none' ? undefined : (data) => ({
      compression: 'zstd',
      compressedData: zstd.compress(data, 3),
    }),
  });
  await writer.start({profile: 'ros2', library: 'oracle'});
  const channels = new Map();
  for (const {stamp, topic, type, bytes} of messages) {
    if (!channels.has(topic)) {
      const schemaId = await writer.registerSchema(
          {name: type, encoding: 'ros2msg', data: Buffer.from('float32 x')});
      channels.set(topic, await writer.registerChannel(
          {schemaId, topic, messageEncoding: 'cdr', metadata: new Map()}));
    }
    await writer.addMessage({channelId: channels.get(topic), sequence: 0, logTime: stamp,
                             publishTime: stamp, data: bytes});
  }
  await writer.end();
  fs.closeSync(file);
}

async function main([what, from, to, ...how]) {
  if (what === 'read') {
    fs.writeFileSync(to, Buffer.concat(await read(from, how[0] === 'stream')));
  } else {
    await write(to, readList(from), how[0], how[1] === 'chunks');
  }
}

main(process.argv.slice(2)).catch((error) => {
  console.error(error);
  process.exit(1);
});
