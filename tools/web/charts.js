// Small charts on a canvas: lines, or areas that stand on each other.
//
//   const chart = new Lamina.Chart(figure, {series: [{name, colour}], unit: 'ms', stacked: true});
//   options.band: [first, last] of x, which is marked; options.limit: a value with a line of its own
//   chart.set(x, [values, ...]);   // x ascending; a value that is not finite breaks the line
//
// `figure` holds a <canvas> and gets a legend that shows the values under the pointer.
(function () {
  'use strict';
  const Lamina = (window.Lamina = window.Lamina || {});
  const kLeft = 40, kRight = 6, kTop = 8, kBottom = 18;

  // 1, 2 or 5 times a power of ten, so that `range` holds about `count` of them.
  function tickStep(range, count) {
    const rough = range / count;
    const power = Math.pow(10, Math.floor(Math.log10(rough)));
    return [1, 2, 5, 10].map((m) => m * power).find((step) => step >= rough);
  }

  function format(value) {
    if (!isFinite(value)) return '–';
    const size = Math.abs(value);
    if (size >= 1000) return value.toFixed(0);
    return size >= 10 ? value.toFixed(1) : value.toFixed(size >= 1 || size === 0 ? 2 : 3);
  }

  class Chart {
    constructor(figure, options) {
      this.options = options;
      this.canvas = figure.querySelector('canvas');
      this.canvas.setAttribute('role', 'img');
      this.x = [];
      this.values = options.series.map(() => []);
      this.pointer = null;
      this.legend = document.createElement('ul');
      this.legend.className = 'chart-legend';
      this.cells = options.series.map((series) => this.addEntry(series));
      figure.append(this.legend);
      this.canvas.addEventListener('pointermove', (event) => this.onPointer(event.offsetX));
      this.canvas.addEventListener('pointerleave', () => this.onPointer(null));
      new ResizeObserver(() => this.draw()).observe(this.canvas);
    }

    addEntry(series) {
      const entry = document.createElement('li');
      const [swatch, name, value] = ['i', 'span', 'b'].map((tag) => document.createElement(tag));
      swatch.style.background = series.colour;
      name.textContent = series.name;
      value.textContent = '–';
      entry.append(swatch, name, value);
      this.legend.append(entry);
      return value;
    }

    set(x, values) {
      this.x = x;
      this.values = values;
      this.draw();
    }

    onPointer(offset) {
      this.pointer = offset;
      this.draw();
    }

    // The value that a series reaches at i, with those below it where they are stacked.
    top(series, i) {
      if (!this.options.stacked) return this.values[series][i];
      let sum = 0;
      for (let s = 0; s <= series; ++s) sum += this.values[s][i] || 0;
      return sum;
    }

    largest() {
      let most = 0;
      for (let i = 0; i < this.x.length; ++i) {
        for (let s = 0; s < this.values.length; ++s) {
          const value = this.top(s, i);
          if (isFinite(value) && value > most) most = value;
        }
      }
      const limit = this.options.limit;
      return Number.isFinite(limit) ? Math.max(most, limit) : most;
    }

    draw() {
      const ratio = window.devicePixelRatio || 1;
      const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
      if (width === 0 || height === 0) return;
      const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
      if (this.canvas.width !== w || this.canvas.height !== h) {
        [this.canvas.width, this.canvas.height] = [w, h];
      }
      const c = this.canvas.getContext('2d');
      c.setTransform(ratio, 0, 0, ratio, 0, 0);
      c.clearRect(0, 0, width, height);
      const n = this.x.length;
      const most = this.largest() || 1;
      const step = tickStep(most, 3);
      const high = step * Math.ceil(most / step);
      const [first, last] = n > 0 ? [this.x[0], this.x[n - 1]] : [0, 1];
      const px = (x) => kLeft + (width - kLeft - kRight) * (x - first) / (last - first || 1);
      const py = (y) => kTop + (height - kTop - kBottom) * (1 - y / high);
      this.drawBand(c, px, height);
      this.drawGrid(c, {width, height, high, step, first, last, px, py});
      for (let s = this.values.length - 1; s >= 0; --s) this.drawSeries(c, s, px, py);
      this.drawLimit(c, width, high, py);
      this.showValues(c, px, height);
    }

    drawBand(c, px, height) {
      if (!this.options.band) return;
      const [from, to] = this.options.band.map(px);
      const width = Math.max(3, to - from), middle = 0.5 * (from + to);
      c.fillStyle = 'rgba(240,99,106,.25)';
      c.fillRect(middle - 0.5 * width, kTop, width, height - kTop - kBottom);
    }

    drawLimit(c, width, high, py) {
      const limit = this.options.limit;
      if (!Number.isFinite(limit) || limit > high) return;
      c.strokeStyle = '#e8b339';
      c.lineWidth = 1;
      c.setLineDash([5, 4]);
      c.beginPath();
      c.moveTo(kLeft, py(limit));
      c.lineTo(width - kRight, py(limit));
      c.stroke();
      c.setLineDash([]);
    }

    drawGrid(c, {width, height, high, step, first, last, px, py}) {
      c.font = '11px system-ui, sans-serif';
      c.fillStyle = '#8b98a9';
      c.strokeStyle = 'rgba(139,152,169,.18)';
      c.lineWidth = 1;
      c.textAlign = 'right';
      c.textBaseline = 'middle';
      for (let y = 0; y <= high * 1.001; y += step) {
        c.beginPath();
        c.moveTo(kLeft, Math.round(py(y)) + 0.5);
        c.lineTo(width - kRight, Math.round(py(y)) + 0.5);
        c.stroke();
        c.fillText(String(+y.toPrecision(3)), kLeft - 5, py(y));
      }
      if (this.x.length < 2) return;
      c.textBaseline = 'alphabetic';
      const xStep = tickStep(last - first, Math.max(2, width / 110));
      c.textAlign = 'center';
      for (let x = xStep * Math.ceil(first / xStep); x <= last; x += xStep) {
        if (px(x) < width - 24) c.fillText(String(+x.toPrecision(8)), px(x), height - 4);
      }
    }

    // Where there are more values than pixels, the largest of each pixel: peaks are what matters.
    columns(series, px) {
      const points = [];
      for (let i = 0; i < this.x.length; ++i) {
        const x = px(this.x[i]), y = this.top(series, i);
        const before = points[points.length - 1];
        if (before && isFinite(y) && isFinite(before[1]) && x - before[0] < 0.5) {
          before[1] = Math.max(before[1], y);
        } else {
          points.push([x, y]);
        }
      }
      return points;
    }

    drawSeries(c, series, px, py) {
      const points = this.columns(series, px);
      if (points.length === 0) return;
      c.beginPath();
      let pen = false;
      for (const [x, y] of points) {
        if (isFinite(y)) c[pen ? 'lineTo' : 'moveTo'](x, py(y));
        pen = isFinite(y);
      }
      if (this.options.stacked) {
        c.lineTo(points[points.length - 1][0], py(0));
        c.lineTo(points[0][0], py(0));
        c.fillStyle = this.options.series[series].colour;
        c.fill();
      } else {
        c.strokeStyle = this.options.series[series].colour;
        c.lineWidth = 1.5;
        c.lineJoin = 'round';
        c.stroke();
      }
    }

    showValues(c, px, height) {
      let at = this.x.length - 1;
      if (this.pointer !== null && at >= 0) {
        // The first whose place is not left of the pointer.
        let low = 0;
        while (low < at) {
          const middle = (low + at) >> 1;
          if (px(this.x[middle]) < this.pointer) low = middle + 1;
          else at = middle;
        }
        c.strokeStyle = 'rgba(230,237,243,.6)';
        c.beginPath();
        c.moveTo(px(this.x[at]), kTop);
        c.lineTo(px(this.x[at]), height - kBottom);
        c.stroke();
      }
      const texts =
          this.values.map((v) => (at >= 0 ? format(v[at]) + ' ' + this.options.unit : '–'));
      texts.forEach((text, s) => (this.cells[s].textContent = text));
      this.canvas.setAttribute('aria-label', (this.options.title || '') + ': ' +
          this.options.series.map((s, i) => s.name + ' ' + texts[i]).join(', '));
    }
  }
  Lamina.Chart = Chart;

  // Stages of a frame, in the order in which they come; the keys of /api/timings and frames.csv.
  Lamina.stages = [
    {key: 'read_ms', name: 'read', colour: '#5b8def'},
    {key: 'prepare_ms', name: 'prepare', colour: '#4fc3e8'},
    {key: 'cluster_ms', name: 'cluster', colour: '#2fb5a0'},
    {key: 'odometry_ms', name: 'odometry', colour: '#8fce6a'},
    {key: 'map_ms', name: 'map', colour: '#e6c458'},
    {key: 'solve_ms', name: 'solve', colour: '#ee8f5d'},
    {key: 'durable_ms', name: 'durable', colour: '#c58af0'},
  ];
})();
