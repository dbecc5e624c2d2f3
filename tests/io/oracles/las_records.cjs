// The records of the points of a LAZ file, or of all nodes of a COPC file (*.copc.laz), as other
// programs read them (npm: copc, laz-perf), to the standard output.
const fs = require('fs');
const {Copc} = require('copc');
const {createLazPerf} = require('laz-perf');

async function laz(path) {
  const bytes = fs.readFileSync(path);
  const lazPerf = await createLazPerf();
  const file = lazPerf._malloc(bytes.length);
  lazPerf.HEAPU8.set(bytes, file);
  const reader = new lazPerf.LASZip();
  reader.open(file, bytes.length);
  const length = reader.getPointLength();
  const point = lazPerf._malloc(length);
  const records = [];
  for (let i = 0; i < reader.getCount(); ++i) {
    reader.getPoint(point);
    records.push(Buffer.from(lazPerf.HEAPU8.subarray(point, point + length)));
  }
  return records;
}

async function copc(path) {
  const file = fs.openSync(path, 'r');
  const get = async (begin, end) => {
    const bytes = Buffer.alloc(end - begin);
    fs.readSync(file, bytes, 0, end - begin, begin);
    return new Uint8Array(bytes);
  };
  const read = await Copc.create(get);
  const records = [];
  const pages = [read.info.rootHierarchyPage];
  while (pages.length > 0) {
    const page = await Copc.loadHierarchyPage(get, pages.pop());
    pages.push(...Object.values(page.pages));
    for (const node of Object.values(page.nodes)) {
      if (node.pointCount === 0) continue;
      records.push(Buffer.from(await Copc.loadPointDataBuffer(get, read.header, node)));
    }
  }
  return records;
}

const path = process.argv[2];
(path.endsWith('.copc.laz') ? copc(path) : laz(path))
    .then((records) => fs.writeFileSync(process.argv[3], Buffer.concat(records)))
    .catch((error) => {
      console.error(error);
      process.exit(1);
    });
