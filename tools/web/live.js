// The live page: asks the daemon for what has changed, and shows it. Reads alone.
(function () {
  'use strict';
  const Lamina = window.Lamina;
  const $ = (id) => document.getElementById(id);
  const kPollMs = 500, kHiddenPollMs = 5000, kRetryMs = 1000, kTimeoutMs = 15000;
  // A client that watches for days thins its trajectory by loading it anew: the daemon keeps less.
  const kMostPoses = 100000;
  const kPagesAtOnce = 8;
  const kMostPlaces = 1000;

  let viewer = null;
  const state = {
    run: null,        // run_id of the daemon that all below comes from
    poses: [],        // by index, of all pieces of the map
    piece: -1,        // the one that is shown: the newest, unless one was chosen
    chosen: false,
    version: -1,      // of the trajectory
    frames: [],       // stage times of the newest frames
    nextTiming: 0,
    mapVersion: -1,
    mapRequest: null, // a loading of the map that has further pages
    covered: [],      // {centre, radius} of what has been loaded of the map
    mapChanged: false, // since the legend was last brought up to date
    scan: -1,
    failures: 0,
  };

  function reset(run) {
    Object.assign(state, {run, poses: [], version: -1, frames: [], nextTiming: 0, chosen: false});
    showPiece(-1);
  }

  // Pieces of the map have frames of their own, and are not connected.
  function showPiece(piece) {
    Object.assign(state, {piece, mapVersion: -1, mapRequest: null, covered: [], scan: -1});
    if (viewer) viewer.clear();
  }

  const shownPoses = () => state.poses.filter((pose) => pose.piece === state.piece);

  function showPoses() {
    const pieces = [...new Set(state.poses.map((pose) => pose.piece))].sort((a, b) => a - b);
    const newest = pieces.length > 0 ? pieces[pieces.length - 1] : -1;
    const gone = !pieces.includes(state.piece);
    if (gone || (!state.chosen && newest > state.piece)) showPiece(newest);
    Lamina.listPieces($('piece'), pieces, state.piece);
    const poses = shownPoses();
    if (viewer) viewer.setTrajectory(poses);
    $('path-length').textContent = Lamina.pathLength(poses).toFixed(1) + ' m';
  }

  async function get(path, type) {
    const abort = new AbortController();
    const timer = setTimeout(() => abort.abort(), kTimeoutMs);
    try {
      const answer = await fetch(path, {cache: 'no-store', signal: abort.signal});
      if (!answer.ok) throw new Error(path + ': ' + answer.status);
      return await answer[type]();
    } finally {
      clearTimeout(timer);
    }
  }

  // The daemon that answered is not the one that this page knows: the next poll starts over.
  class AnotherRun extends Error {}
  function checkRun(run) {
    if (run !== state.run) throw new AnotherRun();
  }

  // ---- what is asked for ----------------------------------------------------------------------

  async function pollStatus() {
    const status = await get('api/status', 'json');
    if (status.run_id !== state.run) reset(status.run_id);
    showStatus(status);
  }

  // New poses come behind the known ones; poses that the window has moved replace theirs.
  function mergePoses(news) {
    if (news.length === 0) return;
    const known = state.poses;
    let at = known.length;
    while (at > 0 && known[at - 1].index >= news[0].index) --at;
    const tail = known.splice(at);
    const byIndex = new Map(tail.map((pose) => [pose.index, pose]));
    for (const pose of news) byIndex.set(pose.index, pose);
    known.push(...[...byIndex.values()].sort((a, b) => a.index - b.index));
  }

  async function pollTrajectory() {
    if (state.poses.length > kMostPoses) {
      state.poses = [];
      state.version = -1;
    }
    let version = null, changed = false;
    for (let from = -1, more = true; more;) {
      const page = Lamina.readTrajectory(
          await get('api/trajectory?since=' + state.version + '&from=' + from, 'arrayBuffer'));
      checkRun(page.run);
      if (version === null) version = page.version;
      mergePoses(page.poses);
      changed = changed || page.poses.length > 0;
      from = page.next;
      more = from >= 0;
    }
    state.version = version;
    if (!changed) return;
    showPoses();
    $('notice').hidden = true;
  }

  async function pollTimings() {
    const page = await get('api/timings?since=' + state.nextTiming, 'json');
    for (let i = 0; i < page.lag_ms.length; ++i) {
      const frame = {number: page.first + i, lag_ms: page.lag_ms[i]};
      for (const stage of Lamina.stages) frame[stage.key] = page[stage.key][i];
      state.frames.push(frame);
    }
    state.nextTiming = page.first + page.lag_ms.length;
    state.frames.splice(0, Math.max(0, state.frames.length - 600));
    const numbers = state.frames.map((f) => f.number);
    stages.set(numbers, Lamina.stages.map((stage) => state.frames.map((f) => f[stage.key])));
    lags.set(numbers, [state.frames.map((f) => f.lag_ms)]);
  }

  async function pollScan() {
    if (!viewer) return;
    if (!$('show-scan').checked) return viewer.hideScan();
    const scan = Lamina.readScan(await get('api/scan', 'arrayBuffer'));
    checkRun(scan.run);
    if (scan.piece !== state.piece) return viewer.hideScan();
    if (scan.index < 0 || (scan.index === state.scan && viewer.scan.visible)) return;
    state.scan = scan.index;
    viewer.setScan(scan);
  }

  const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

  // What to load next: the surroundings of a place that the eye has moved to, in full; else what
  // has changed around the sensor, which is all that there is to see while the eye follows it.
  function nextMapRequest(sensor) {
    const radius = Number($('radius').value);
    const target = viewer.follow ? sensor : viewer.target();
    const covered = viewer.follow ? state.covered.length > 0 :
        state.covered.some((c) => distance(c.centre, target) < c.radius / 2);
    if (state.mapVersion < 0 || !covered) {
      return {centre: target, radius, newerThan: -1, page: 0, kept: Infinity};
    }
    return {centre: sensor, radius, newerThan: state.mapVersion, page: 0, kept: Infinity};
  }

  async function pollMap() {
    const poses = shownPoses();
    if (!viewer || poses.length === 0) return false;
    const sensor = poses[poses.length - 1].position;
    const request = state.mapRequest || nextMapRequest(sensor);
    const budget = Number($('budget').value), piece = state.piece;
    for (let pages = 0; pages < kPagesAtOnce; ++pages) {
      const [x, y, z] = request.centre;
      const page = Lamina.readMap(await get(
          `api/map?x=${x}&y=${y}&z=${z}&radius=${request.radius}&page=${request.page}` +
          `&newer_than=${request.newerThan}&piece=${piece}`, 'arrayBuffer'));
      checkRun(page.run);
      // Another piece was chosen meanwhile.
      if (piece !== state.piece) return true;
      // What changes while the pages come is newer than the first one's version.
      if (request.page === 0) request.version = page.version;
      if (page.cells > 0) {
        viewer.addMap(page);
        state.mapChanged = true;
      }
      // Room is made where the eye is not.
      const kept = viewer.map.keepNear(viewer.target(), budget);
      request.kept = Math.min(request.kept, kept);
      // Cells come from near to far: what follows would have to go again at once.
      const inVain = request.newerThan < 0 && page.last &&
          distance(page.last, request.centre) > kept;
      if (page.next === 0 || inVain) return finishMap(request, sensor);
      request.page = page.next;
    }
    state.mapRequest = request;
    return true;
  }

  function finishMap(request, sensor) {
    state.mapRequest = null;
    const {centre, radius, kept} = request;
    if (request.newerThan >= 0 || state.mapVersion < 0) state.mapVersion = request.version;
    if (request.newerThan < 0) {
      state.covered.push({centre, radius});
    } else if (!state.covered.some((c) => distance(c.centre, sensor) < c.radius / 4)) {
      state.covered.push({centre: sensor, radius});
    }
    state.covered.splice(0, state.covered.length - kMostPlaces);
    // Around the eye, everything is there up to `kept`; what was beyond had to make room.
    const eye = viewer.target();
    for (const c of state.covered) {
      c.radius = Math.min(c.radius, Math.max(20, kept - distance(c.centre, eye)));
    }
    if (state.mapChanged || kept < Infinity) {
      state.mapChanged = false;
      $('surfels').textContent = viewer.map.count.toLocaleString('en');
      updateLegend();
    }
    return false;
  }

  // ---- what is shown --------------------------------------------------------------------------

  function bytes(n) {
    const [size, unit] = n >= 1e9 ? [n / 1e9, ' GB'] : [n / 1e6, ' MB'];
    return size.toFixed(size >= 10 ? 0 : 1) + unit;
  }
  function duration(s) {
    if (s < 60) return s.toFixed(0) + ' s';
    if (s < 3600) return Math.floor(s / 60) + ' min ' + Math.floor(s % 60) + ' s';
    if (s < 86400) return Math.floor(s / 3600) + ' h ' + Math.floor(s % 3600 / 60) + ' min';
    return Math.floor(s / 86400) + ' d ' + Math.floor(s % 86400 / 3600) + ' h';
  }

  function showState(text, tone) {
    $('state').textContent = text;
    $('state').dataset.tone = tone;
  }

  function showMessage(status) {
    const directions = status.degenerate_directions;
    const [text, tone] = status.failure ? [status.failure, 'bad'] :
        status.degenerate_now ?
            ['The scene holds the pose in all but ' + directions +
             (directions === 1 ? ' direction' : ' directions'), 'warn'] :
            [status.last_error ? 'Last error: ' + status.last_error : '', ''];
    $('message').textContent = text;
    $('message').dataset.tone = tone;
  }

  function showStatus(s) {
    const tone = s.failure ? 'bad' : s.degenerate_now ? 'warn' :
        s.state === 'mapping' || s.state === 'localising' ? 'good' : '';
    showState(s.failure ? 'failed' : s.state, tone);
    showMessage(s);
    Lamina.showVerdict($('verdict'), s.verdict);
    const texts = {
      frames: s.frames.toLocaleString('en') + ', ' + s.keyframes.toLocaleString('en') + ' key',
      rate: s.rate_hz.toFixed(1) + ' Hz',
      lag: s.lag_s < 10 ? (1000 * s.lag_s).toFixed(0) + ' ms' : duration(s.lag_s),
      queue: s.queue.toLocaleString('en') + (s.queue === 1 ? ' file' : ' files'),
      'map-bytes': bytes(s.map_bytes) +
          (s.map_budget_bytes ? ' of ' + bytes(s.map_budget_bytes) : ''),
      memory: bytes(s.rss_bytes) + ', ' + s.tiles_on_disk,
      troubles: [s.lost, s.degenerate, s.skipped, s.rejected, s.late].join(', '),
      checkpoint: s.checkpoint ? duration(s.checkpoint.age_s) + ' ago' : 'none yet',
      uptime: duration(s.uptime_s),
      position: s.last_pose ?
          s.last_pose.position_m.map((v) => v.toFixed(2)).join(', ') + ' m' : '–',
    };
    for (const [id, text] of Object.entries(texts)) $(id).textContent = text;
    document.title = 'Lamina: ' + s.state + ', ' + s.frames;
  }

  function showConnection(error) {
    if (!error) {
      state.failures = 0;
      $('banner').hidden = true;
      return;
    }
    ++state.failures;
    showState('no connection', 'bad');
    $('banner').textContent = 'No connection to Lamina. Trying again …';
    $('banner').hidden = false;
  }

  // ---- the loop -------------------------------------------------------------------------------

  let wake = null;
  function sleep(ms) {
    return new Promise((resolve) => {
      const timer = setTimeout(resolve, ms);
      wake = () => {
        clearTimeout(timer);
        resolve();
      };
    });
  }

  // Returns how long to wait before the next one.
  async function poll() {
    try {
      await pollStatus();
      await pollTrajectory();
      await pollTimings();
      await pollScan();
      const more = await pollMap();
      showConnection(null);
      return more ? 20 : document.hidden ? kHiddenPollMs : kPollMs;
    } catch (error) {
      if (error instanceof AnotherRun) return 20;
      showConnection(error);
      return kRetryMs;
    }
  }

  async function run() {
    for (;;) await sleep(await poll());
  }

  // ---- start ----------------------------------------------------------------------------------

  const stages = new Lamina.Chart($('stages'), {
    title: 'Stages of a frame', unit: 'ms', stacked: true, series: Lamina.stages});
  const lags = new Lamina.Chart($('lags'), {
    title: 'Lag', unit: 'ms', series: [{name: 'lag', colour: '#4cb8ff'}]});
  try {
    viewer = new Lamina.Viewer($('view'));
    viewer.setSize(Number($('size').value));
    // Who takes hold of the camera may have been following; a turn is no wish to stop.
    $('follow').addEventListener('change', () => {
      viewer.setFollow($('follow').checked);
      // The surroundings of the sensor may have made room for those of another place.
      if ($('follow').checked) state.covered = [];
    });
    $('size').addEventListener('input', () => viewer.setSize(Number($('size').value)));
    $('show-path').addEventListener('change', () => viewer.showPath($('show-path').checked));
  } catch (error) {
    $('notice').textContent = 'No 3D view: ' + error.message + (window.THREE ? '' :
        ' (Debian: apt install libjs-three). The figures beside are live all the same.');
  }
  const updateLegend = Lamina.bindColours(viewer, $('colour'), $('legend'));
  $('budget').value = matchMedia('(max-width: 760px)').matches ? '300000' : '2000000';
  for (const id of ['radius', 'budget']) {
    $(id).addEventListener('change', () => {
      state.mapRequest = null;
      state.covered = [];
      if (wake) wake();
    });
  }
  $('piece').addEventListener('change', () => {
    state.chosen = true;
    showPiece(Number($('piece').value));
    showPoses();
    if (wake) wake();
  });
  document.addEventListener('visibilitychange', () => wake && wake());
  document.addEventListener('keydown', (event) => {
    const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
    if (event.key.toLowerCase() === 'f' && !event.ctrlKey && !event.metaKey && !typing) {
      $('follow').click();
    }
  });
  window.lamina = {viewer, state};  // for tests, and for the console
  run();
})();
