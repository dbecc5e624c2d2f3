// The report: everything it shows is in the page's own data (tools/report_data.h).
(function () {
  'use strict';
  const Lamina = window.Lamina;
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($('data').textContent);

  const {bytes, floats} = Lamina;
  const count = (n) => n.toLocaleString('en');

  function addFigure(list, name, value) {
    const [box, term, text] = ['div', 'dt', 'dd'].map((tag) => document.createElement(tag));
    term.textContent = name;
    text.textContent = value;
    box.append(term, text);
    list.append(box);
  }

  const groupNote = (group, of) => group > 1 ?
      'Each point is the largest of ' + group + ' ' + of + '. ' : '';

  // ---- the sections ---------------------------------------------------------------------------

  const poses = Lamina.readTrajectory(bytes(data.trajectory)).poses;

  function showOutline() {
    document.title = $('name').textContent = 'Lamina: ' + data.name;
    const seconds = poses[poses.length - 1].stamp_s - poses[0].stamp_s;
    $('outline').textContent = count(poses.length) + ' poses, ' +
        Lamina.pathLength(poses).toFixed(1) + ' m in ' + seconds.toFixed(1) + ' s, ' +
        count(data.map.surfels) + ' surfels';
  }

  // Pieces of the map have frames of their own, and are not connected: one is shown at a time.
  const pieces = [...new Set(poses.map((pose) => pose.piece))].sort((a, b) => a - b);
  const mapOf = (piece) => piece === 0 ? data.map :
      (data.further_maps || []).find((map) => map.piece === piece);

  function showPiece(viewer, piece) {
    const map = mapOf(piece), shown = poses.filter((pose) => pose.piece === piece);
    $('map-note').textContent = !map ? 'This piece has no surfels.' : map.shown < map.surfels ?
        'The map is thinned: ' + count(map.shown) + ' of ' + count(map.surfels) +
            ' surfels are shown.' :
        'All ' + count(map.surfels) + ' surfels are shown.';
    if (pieces.length > 1) {
      $('map-note').textContent += ' ' + pieces.length +
          ' pieces of the map are not connected; each is shown in a frame of its own.';
    }
    if (!viewer) return;
    viewer.clear();
    viewer.setTrajectory(shown);
    if (map) viewer.addMap(Lamina.readMap(bytes(map.cells)));
    viewer.showAll(shown);
  }

  function showView() {
    showPiece(null, pieces[0]);
    if (data.truth) $('map-note').textContent += ' Yellow: the trajectory; blue: the truth.';
    let viewer = null;
    try {
      viewer = new Lamina.Viewer($('view'));
    } catch (error) {
      $('notice').hidden = false;
      $('notice').textContent = 'No 3D view: ' + error.message;
      return null;
    }
    viewer.follow = false;
    viewer.setSize(Number($('size').value));
    showPiece(viewer, pieces[0]);
    if (data.truth) viewer.setTruth(Lamina.readTrajectory(bytes(data.truth.poses)).poses);
    Lamina.listPieces($('piece'), pieces, pieces[0]);
    const chosen = () => Number($('piece').value);
    $('piece').addEventListener('change', () => showPiece(viewer, chosen()));
    // A report does not know when a surfel was seen last.
    Lamina.colourings = Lamina.colourings.filter((c) => c.id !== 'age');
    Lamina.bindColours(viewer, $('colour'), $('legend'));
    $('size').addEventListener('input', () => viewer.setSize(Number($('size').value)));
    $('show-path').addEventListener('change', () => viewer.showPath($('show-path').checked));
    $('all').addEventListener(
        'click', () => viewer.showAll(poses.filter((pose) => pose.piece === chosen())));
    return viewer;
  }

  function showErrors(truth) {
    $('error-section').hidden = false;
    const figures = truth.figures;
    const show = (name, value, digits, unit) =>
        addFigure($('errors'), name, value === null ? '–' : value.toFixed(digits) + ' ' + unit);
    show('APE, RMSE', figures.ape_rmse_m, 4, 'm');
    show('APE, largest', figures.ape_max_m, 4, 'm');
    show('RPE, RMSE', figures.rpe_rmse_m, 4, 'm');
    show('RPE, RMSE', figures.rpe_rmse_deg, 4, '°');
    show('KITTI, translation', figures.kitti_trel_percent, 4, '%');
    show('Path of the truth', figures.length_m, 1, 'm');
    const axis = floats(truth.axis);
    const draw = (id, title, unit, values) => new Lamina.Chart($(id), {
      title, unit, series: [{name: title, colour: '#4cb8ff'}]}).set(axis, [floats(values)]);
    draw('position-error', 'position error', 'm', truth.position_m);
    draw('rotation-error', 'rotation error', '°', truth.rotation_deg);
    $('error-note').textContent = groupNote(truth.group, 'poses') + 'Over ' +
        (truth.axis_name === 's' ? 'time, s' : 'scans') + '. Alignment: ' + figures.alignment + '.';
  }

  function showTimings(timings) {
    $('time-section').hidden = false;
    const stages = Lamina.stages.filter((stage) => stage.key in timings.stages);
    new Lamina.Chart($('stages'), {title: 'Stages', unit: 'ms', stacked: true, series: stages})
        .set(floats(timings.scan), stages.map((stage) => floats(timings.stages[stage.key])));
    $('time-note').textContent = groupNote(timings.group, 'scans') +
        'Stages of several scans run at the same time: their sum is work, not delay.';
  }

  function showSummary(summary) {
    $('summary-section').hidden = false;
    for (const [key, value] of Object.entries(summary)) {
      const row = $('summary').insertRow();
      const name = document.createElement('th');
      name.scope = 'row';
      name.textContent = key;
      row.append(name);
      row.insertCell().textContent = typeof value === 'number' ?
          (Number.isInteger(value) ? count(value) : String(+value.toPrecision(6))) :
          typeof value === 'object' ? JSON.stringify(value) : String(value);
    }
  }

  function showVerdict(verdict) {
    $('verdict-section').hidden = false;
    Lamina.showVerdict($('verdict'), verdict);
  }

  showOutline();
  if (data.verdict) showVerdict(data.verdict);
  const viewer = showView();
  if (data.truth) showErrors(data.truth);
  if (data.timings) showTimings(data.timings);
  if (data.summary) showSummary(data.summary);
  window.lamina = {viewer, poses};  // for tests, and for the console
})();
