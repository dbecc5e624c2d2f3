// The page of `lamina doctor`: everything it shows is in its own data (tools/doctor_data.h).
(function () {
  'use strict';
  const Lamina = window.Lamina;
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($('data').textContent);
  const kSvg = 'http://www.w3.org/2000/svg';
  const kSize = 300;

  function add(parent, tag, text, className) {
    const element = document.createElement(tag);
    if (text) element.textContent = text;
    if (className) element.className = className;
    parent.append(element);
    return element;
  }

  function addShape(svg, tag, attributes) {
    const shape = document.createElementNS(kSvg, tag);
    for (const [name, value] of Object.entries(attributes)) shape.setAttribute(name, value);
    svg.append(shape);
    return shape;
  }

  // ---- pictures from above --------------------------------------------------------------------

  // [[x, y], ...] of a base64 text.
  function points(base64) {
    const values = Lamina.floats(base64);
    const list = [];
    for (let i = 0; i + 1 < values.length; i += 2) list.push([values[i], values[i + 1]]);
    return list;
  }

  // What lies in a square around `centre`, its side 2 * radius metres; y is up.
  function addView(parent, title, centre, radius) {
    const figure = add(parent, 'figure');
    add(figure, 'figcaption', title);
    const svg = addShape(figure, 'svg', {
      viewBox: '0 0 ' + kSize + ' ' + kSize, role: 'img', 'aria-label': title, class: 'above'});
    const scale = 0.5 * kSize / radius;
    const at = ([x, y]) => [
      (0.5 * kSize + (x - centre[0]) * scale).toFixed(1),
      (0.5 * kSize - (y - centre[1]) * scale).toFixed(1)];
    const path = (list) => 'M' + list.map((p) => at(p).join(' ')).join('L');
    return {
      line: (list, className) => list.length > 0 &&
          addShape(svg, 'path', {d: path(list), class: className}),
      dots: (list, className) => list.length > 0 && addShape(
          svg, 'path', {d: list.map((p) => 'M' + at(p).join(' ') + 'h0').join(''), class: className}),
      // As long as 1, 2 or 5 times a power of ten, in metres.
      bar: () => {
        const power = Math.pow(10, Math.floor(Math.log10(radius)));
        const metres = [5, 2, 1, 0.5].map((m) => m * power).find((m) => m <= 0.6 * radius);
        const [left, y] = [12, kSize - 12];
        addShape(svg, 'path', {d: 'M' + left + ' ' + y + 'h' + (metres * scale).toFixed(1), class: 'bar'});
        addShape(svg, 'text', {x: left, y: y - 6}).textContent = +metres.toPrecision(2) + ' m';
      },
    };
  }

  function addWay(parent, picture) {
    const way = points(data.paths[picture.piece]), here = points(picture.here);
    const low = [0, 1].map((k) => way.reduce((m, p) => Math.min(m, p[k]), Infinity));
    const high = [0, 1].map((k) => way.reduce((m, p) => Math.max(m, p[k]), -Infinity));
    const radius = 0.55 * Math.max(high[0] - low[0], high[1] - low[1], 1);
    const view = addView(parent, 'The way of the run, the place in red',
                         [0, 1].map((k) => 0.5 * (low[k] + high[k])), radius);
    view.line(way, 'way');
    view.line(here, 'here');
    view.dots(here, 'here');
    view.bar();
  }

  function addMap(parent, picture) {
    const map = points(picture.map);
    if (map.length === 0) return;
    const view = addView(parent, 'The map around it', picture.centre, picture.radius_m);
    view.dots(map, 'surfel');
    view.line(points(data.paths[picture.piece]), 'way');
    view.line(points(picture.here), 'here');
    view.dots(points(picture.here), 'here');
    view.bar();
  }

  function addChart(parent, chart) {
    const figure = add(parent, 'figure');
    add(figure, 'figcaption', chart.title + (chart.unit ? ', ' + chart.unit : '') +
        ', by scan; the place in red' + (chart.limit === null ? '' : ', the limit dashed'));
    add(figure, 'canvas');
    new Lamina.Chart(figure, {
      title: chart.title, unit: chart.unit, band: chart.band, limit: chart.limit,
      series: [{name: chart.title, colour: '#4cb8ff'}],
    }).set(Lamina.floats(chart.scan), [Lamina.floats(chart.values)]);
  }

  // ---- the page -------------------------------------------------------------------------------

  function addPlace(place, number) {
    const item = add($('places'), 'li', '', 'place');
    item.id = 'place-' + number;
    add(item, 'h3', number + '. ' + place.symptom);
    add(item, 'p', place.where, 'note');
    const list = add(item, 'dl');
    const row = (name, text) => {
      if (!text) return null;
      add(list, 'dt', name);
      return add(list, 'dd', text);
    };
    row('Files', place.files);
    row('Measured', place.measured);
    row('Likely cause', place.cause);
    if (place.settings.length > 0) {
      add(list, 'dt', 'Change');
      const change = add(list, 'dd');
      for (const setting of place.settings) add(change, 'code', '--set ' + setting);
    }
    row(place.settings.length > 0 ? 'Or' : 'Change', place.record);
    if (place.beside.length > 0) {
      add(list, 'dt', 'See also');
      const links = add(list, 'dd');
      for (const other of place.beside) {
        const link = add(links, 'a', 'place ' + other);
        link.href = '#place-' + other;
      }
    }
    const pictures = add(item, 'div', '', 'pictures');
    if (place.picture) {
      addWay(pictures, place.picture);
      addMap(pictures, place.picture);
    }
    if (place.chart) addChart(pictures, place.chart);
  }

  document.title = $('name').textContent = 'Lamina doctor: ' + data.name;
  $('outline').textContent = data.outline;
  Lamina.showVerdict($('verdict'), data.verdict);
  for (const note of data.notes) add($('notes'), 'li', note);
  $('found').textContent = data.found === 0 ? 'No weak place was found.' :
      data.found > data.places.length ?
      'The first ' + data.places.length + ' of ' + data.found + '.' : '';
  data.places.forEach((place, i) => addPlace(place, i + 1));
  window.lamina = {data};  // for tests, and for the console
})();
