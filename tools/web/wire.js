// Readers of the binary forms of tools/live_wire.h, and of those in base64 in a page's own data.
(function () {
  'use strict';
  const Lamina = (window.Lamina = window.Lamina || {});

  Lamina.bytes = function (base64) {
    const text = atob(base64);
    const array = new Uint8Array(text.length);
    for (let i = 0; i < text.length; ++i) array[i] = text.charCodeAt(i);
    return array.buffer;
  };
  Lamina.floats = (base64) => new Float32Array(Lamina.bytes(base64));

  function reader(buffer, magic) {
    const view = new DataView(buffer);
    let name = '';
    for (let i = 0; i < 4; ++i) name += String.fromCharCode(view.getUint8(i));
    if (name !== magic) throw new Error('expected ' + magic + ', the server sent ' + name);
    return view;
  }
  const int64 = (view, at) => Number(view.getBigInt64(at, true));
  const runId = (view) => view.getBigUint64(8, true).toString(16).padStart(16, '0');

  Lamina.readTrajectory = function (buffer) {
    const view = reader(buffer, 'LTR2');
    const count = view.getUint32(4, true);
    const poses = [];
    for (let i = 0, at = 32; i < count; ++i, at += 64) {
      poses.push({
        index: int64(view, at),
        stamp_s: int64(view, at + 8) * 1e-9,
        position: [16, 24, 32].map((o) => view.getFloat64(at + o, true)),
        quaternion: [40, 44, 48, 52].map((o) => view.getFloat32(at + o, true)),
        piece: int64(view, at + 56),
      });
    }
    return {run: runId(view), version: int64(view, 16), next: int64(view, 24), poses};
  };

  Lamina.readScan = function (buffer) {
    const view = reader(buffer, 'LSC2');
    return {
      run: runId(view),
      index: int64(view, 16),
      origin: [24, 32, 40].map((o) => view.getFloat64(o, true)),
      piece: int64(view, 48),
      points: new Float32Array(buffer, 56, 3 * view.getUint32(4, true)),
    };
  };

  // Surfels stay in the buffer; SurfelMap.add reads them there.
  Lamina.readMap = function (buffer) {
    const view = reader(buffer, 'LMP1');
    return {
      run: runId(view),
      cells: view.getUint32(4, true),
      version: int64(view, 16),
      cellSize: view.getFloat64(24, true),
      surfels: view.getUint32(32, true),
      next: view.getUint32(36, true),
      buffer,
    };
  };

  // Fills the list of pieces of the map and shows it if there is a choice. Pieces have frames of
  // their own: one of them is drawn at a time.
  Lamina.listPieces = function (select, pieces, shown) {
    if (select.options.length !== pieces.length) {
      select.replaceChildren(...pieces.map((piece) => new Option(piece, piece)));
    }
    select.value = shown;
    select.hidden = pieces.length < 2;
    for (const label of select.labels) label.hidden = select.hidden;
  };

  Lamina.pathLength = function (poses) {
    let length = 0;
    for (let i = 1; i < poses.length; ++i) {
      const a = poses[i - 1].position, b = poses[i].position;
      length += Math.hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]);
    }
    return length;
  };
})();
