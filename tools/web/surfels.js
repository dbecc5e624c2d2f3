// The surfels of the map, as three.js draws them: a draw call for each block of the world. Needs
// three.js.
(function () {
  'use strict';
  const Lamina = (window.Lamina = window.Lamina || {});

  // Five stops each, for the shader and for the legend. `range` gives the values at both ends.
  Lamina.colourings = [
    {id: 'height', name: 'Height', stops: ['#35508f', '#2b8f9a', '#5fb878', '#e3c46b', '#e2703a'],
     label: (v) => v.toFixed(1) + ' m'},
    {id: 'thickness', name: 'Thickness',
     stops: ['#4b8df8', '#35b6b0', '#7cc55b', '#e8a33d', '#e5484d'],
     label: (v) => (1000 * v).toFixed(0) + ' mm'},
    {id: 'age', name: 'Age', stops: ['#fff3b8', '#f4a259', '#c8553d', '#6d3b6f', '#33375c'],
     label: (v) => (v < 1 ? 'new' : v.toFixed(0) + ' keyframes')},
  ];

  const kBlockMetres = 64;
  const kRecordWords = 6;  // 24 bytes

  // A point sprite cut to the disc that the surfel is: at a pixel p of the sprite, the ray through
  // it meets the surfel's plane at p + t d with n . (p + t d) = 0.
  const kVertexShader = `
    attribute vec3 surfelNormal;
    attribute vec3 surfelData;  // radius, thickness, last keyframe
    uniform float pixels, size, now, low, high, height;  // height: of the scene's origin
    uniform int colouring;
    uniform vec3 stops[5];
    varying vec3 vNormal, vColour, vRay;
    vec3 ramp(float t) {
      float x = 4.0 * clamp(t, 0.0, 1.0);
      vec3 c = mix(stops[0], stops[1], clamp(x, 0.0, 1.0));
      c = mix(c, stops[2], clamp(x - 1.0, 0.0, 1.0));
      c = mix(c, stops[3], clamp(x - 2.0, 0.0, 1.0));
      return mix(c, stops[4], clamp(x - 3.0, 0.0, 1.0));
    }
    void main() {
      vec4 eye = modelViewMatrix * vec4(position, 1.0);
      gl_Position = projectionMatrix * eye;
      gl_PointSize = clamp(2.0 * size * surfelData.x * pixels / max(-eye.z, 1e-3), 2.0, 200.0);
      if (surfelData.x <= 0.0) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
      vNormal = normalize(normalMatrix * surfelNormal);
      vRay = eye.xyz / max(-eye.z, 1e-3);
      float value = colouring == 0 ? (modelMatrix * vec4(position, 1.0)).z + height : surfelData.y;
      if (colouring == 2) value = log2(1.0 + max(0.0, now - surfelData.z));
      float light = 0.5 + 0.5 * abs(dot(vNormal, normalize(vRay)));
      vColour = light * ramp((value - low) / max(high - low, 1e-6));
    }`;
  const kFragmentShader = `
    varying vec3 vNormal, vColour, vRay;
    void main() {
      vec3 p = vec3(2.0 * gl_PointCoord.x - 1.0, 1.0 - 2.0 * gl_PointCoord.y, 0.0);
      float along = dot(vNormal, vRay);
      // Edge-on discs stay a hair wide, or walls would vanish when looked along.
      along = (along < 0.0 ? -1.0 : 1.0) * max(abs(along), 0.2);
      vec3 onDisc = p - vRay * (dot(vNormal, p) / along);
      if (dot(onDisc, onDisc) > 1.0) discard;
      gl_FragColor = vec4(vColour, 1.0);
    }`;

  // All surfels of a cube of the world: one draw call. Cells own ranges of the arrays; a cell that
  // outgrows its range moves to the end, and the holes are closed when they are half of the whole.
  class Block {
    constructor(corner, sceneOrigin, metres, material) {
      this.corner = corner;
      this.metres = metres;
      this.cells = new Map();  // place in the block -> {start, room, count}
      this.used = 0;
      this.live = 0;
      this.allocate(512);
      this.points = new THREE.Points(new THREE.BufferGeometry(), material);
      this.points.position.set(...corner.map((c, i) => c - sceneOrigin[i]));
      this.points.matrixAutoUpdate = false;
      this.points.updateMatrix();
      const half = metres / 2;
      this.sphere =
          new THREE.Sphere(new THREE.Vector3(half, half, half), 1.1 * half * Math.sqrt(3) + 1);
      this.fresh = true;
    }

    allocate(room) {
      const grown = {
        room,
        position: new Float32Array(3 * room),
        normal: new Int8Array(4 * room),
        data: new Float32Array(3 * room),
      };
      if (this.arrays) {
        grown.position.set(this.arrays.position.subarray(0, 3 * this.used));
        grown.normal.set(this.arrays.normal.subarray(0, 4 * this.used));
        grown.data.set(this.arrays.data.subarray(0, 3 * this.used));
      }
      this.arrays = grown;
      this.fresh = true;
      this.dirty = [0, this.used];
    }

    touch(start, end) {
      this.dirty = [Math.min(this.dirty[0], start), Math.max(this.dirty[1], end)];
    }

    // `word` is where the cell's records start in the page's arrays.
    set(place, count, page, word) {
      let cell = this.cells.get(place);
      if (cell && count > cell.room) {
        this.hide(cell.start, cell.room);
        this.live -= cell.count;
        cell = null;
      }
      if (!cell) {
        if (count === 0) return this.cells.delete(place);
        const room = count + (count >> 2);
        if (this.used + room > this.arrays.room) {
          this.allocate(Math.ceil(1.6 * (this.used + room)));
        }
        cell = {start: this.used, room, count: 0};
        this.cells.set(place, cell);
        this.used += room;
        this.hide(cell.start, room);
      }
      this.write(cell.start, count, page, word);
      this.hide(cell.start + count, cell.room - count);
      this.touch(cell.start, cell.start + cell.room);
      this.live += count - cell.count;
      cell.count = count;
    }

    write(start, count, page, word) {
      const {position, normal, data} = this.arrays;
      const shift = page.shift;
      for (let i = start; i < start + count; ++i, word += kRecordWords) {
        for (let k = 0; k < 3; ++k) position[3 * i + k] = page.floats[word + k] + shift[k];
        for (let k = 0; k < 3; ++k) normal[4 * i + k] = page.bytes[4 * (word + 3) + k];
        data[3 * i] = 1e-3 * page.shorts[2 * (word + 4)];
        data[3 * i + 1] = 1e-4 * page.shorts[2 * (word + 4) + 1];
        data[3 * i + 2] = page.ints[word + 5];
      }
    }

    hide(start, count) {
      const data = this.arrays.data;
      for (let i = start; i < start + count; ++i) data[3 * i] = 0;
      this.touch(start, start + count);
    }

    compact() {
      const from = this.arrays;
      this.arrays = null;
      const cells = [...this.cells.values()];
      this.used = cells.reduce((sum, cell) => sum + cell.room, 0);
      this.allocate(Math.ceil(1.2 * this.used) + 64);
      let at = 0;
      for (const cell of cells) {
        const copy = (name, n) => this.arrays[name].set(
            from[name].subarray(n * cell.start, n * (cell.start + cell.room)), n * at);
        copy('position', 3);
        copy('normal', 4);
        copy('data', 3);
        cell.start = at;
        at += cell.room;
      }
      this.touch(0, this.used);
    }

    // Brings the graphics card's copy up to date.
    upload() {
      if (this.used > 4096 && this.used > 3 * this.live) this.compact();
      if (this.dirty[0] >= this.dirty[1]) return;
      const layout = [['position', 'position', 3, false], ['surfelNormal', 'normal', 4, true],
                      ['surfelData', 'data', 3, false]];
      if (this.fresh) {
        this.points.geometry.dispose();
        const geometry = this.points.geometry = new THREE.BufferGeometry();
        for (const [attribute, name, n, normalized] of layout) {
          geometry.setAttribute(
              attribute, new THREE.BufferAttribute(this.arrays[name], n, normalized));
        }
        geometry.boundingSphere = this.sphere;
        this.fresh = false;
      } else {
        for (const [attribute, , n] of layout) {
          const a = this.points.geometry.getAttribute(attribute);
          a.updateRange = {offset: n * this.dirty[0], count: n * (this.dirty[1] - this.dirty[0])};
          a.needsUpdate = true;
        }
      }
      this.points.geometry.setDrawRange(0, this.used);
      this.dirty = [Infinity, 0];
    }
  }

  class SurfelMap {
    constructor() {
      this.group = new THREE.Group();
      this.blocks = new Map();
      this.count = 0;
      this.newestKeyframe = 0;
      const number = (value) => ({value});
      this.material = new THREE.ShaderMaterial({
        uniforms: {
          pixels: number(1), size: number(1), now: number(0), low: number(0), high: number(1),
          height: number(0), colouring: number(0),
          stops: number([0, 1, 2, 3, 4].map(() => new THREE.Color())),
        },
        vertexShader: kVertexShader,
        fragmentShader: kFragmentShader,
      });
    }

    clear() {
      for (const key of [...this.blocks.keys()]) this.drop(key);
      this.newestKeyframe = 0;
    }

    drop(key) {
      const block = this.blocks.get(key);
      this.group.remove(block.points);
      block.points.geometry.dispose();
      this.count -= block.live;
      this.blocks.delete(key);
    }

    // Takes in a page of the map (Lamina.readMap); each of its cells replaces what was there. Sets
    // page.last to the place of its last cell.
    add(page, sceneOrigin) {
      const perBlock = Math.max(1, Math.round(kBlockMetres / page.cellSize));
      const metres = perBlock * page.cellSize;
      page.floats = new Float32Array(page.buffer);
      page.ints = new Int32Array(page.buffer);
      page.shorts = new Uint16Array(page.buffer);
      page.bytes = new Int8Array(page.buffer);
      for (let i = 0, word = 10; i < page.cells; ++i) {
        const cell = [0, 1, 2].map((k) => page.ints[word + k]);
        page.last = cell.map((c) => (c + 0.5) * page.cellSize);
        const count = page.ints[word + 3];
        const place = cell.map((c) => Math.floor(c / perBlock));
        const within = cell.map((c, k) => c - perBlock * place[k]);
        const key = place.join(',');
        let block = this.blocks.get(key);
        if (!block) {
          block = new Block(place.map((p) => p * metres), sceneOrigin, metres, this.material);
          this.blocks.set(key, block);
          this.group.add(block.points);
        }
        page.shift = within.map((w) => w * page.cellSize);
        this.count -= block.live;
        block.set((within[2] * perBlock + within[1]) * perBlock + within[0], count, page, word + 4);
        this.count += block.live;
        for (let s = 0; s < count; ++s) {
          const keyframe = page.ints[word + 4 + kRecordWords * s + 5];
          if (keyframe > this.newestKeyframe) this.newestKeyframe = keyframe;
        }
        word += 4 + kRecordWords * count;
      }
    }

    // Forgets the blocks that are farthest from a place until the rest is within the budget.
    // Returns the distance up to which everything is still there.
    keepNear(place, budget) {
      if (this.count <= budget) return Infinity;
      // From the middle of a block.
      const far = (b) => Math.hypot(...b.corner.map((c, i) => c + b.metres / 2 - place[i]));
      const order = [...this.blocks.entries()].sort((a, b) => far(b[1]) - far(a[1]));
      let kept = Infinity;
      for (const [key, block] of order) {
        if (this.count <= budget || this.blocks.size === 1) break;
        kept = Math.max(0, far(block) - block.metres * Math.sqrt(3) / 2);
        this.drop(key);
      }
      return kept;
    }

    // Heights between which all but a few outliers lie, from a sample.
    heights() {
      const sample = [];
      const step = Math.max(1, Math.floor(this.count / 20000));
      for (const block of this.blocks.values()) {
        for (let i = 0; i < block.used; i += step) {
          if (block.arrays.data[3 * i] <= 0) continue;
          sample.push(block.arrays.position[3 * i + 2] + block.corner[2]);
        }
      }
      if (sample.length === 0) return [0, 1];
      sample.sort((a, b) => a - b);
      const at = (share) => sample[Math.floor(share * (sample.length - 1))];
      return [at(0.02), Math.max(at(0.98), at(0.02) + 0.5)];
    }

    range(colouring) {
      if (colouring === 'height') return this.heights();
      if (colouring === 'thickness') return [0, 0.05];
      return [0, Math.max(1, this.newestKeyframe)];
    }

    colour(colouring) {
      const k = Lamina.colourings.findIndex((c) => c.id === colouring);
      const uniforms = this.material.uniforms;
      const range = this.range(colouring);
      uniforms.colouring.value = k;
      Lamina.colourings[k].stops.forEach((stop, i) => uniforms.stops.value[i].set(stop));
      uniforms.now.value = this.newestKeyframe;
      // Age is shown by its logarithm: the newest differ most.
      const shown = colouring === 'age' ? range.map((v) => Math.log2(1 + v)) : range;
      [uniforms.low.value, uniforms.high.value] = shown;
      return range;
    }
  }
  Lamina.SurfelMap = SurfelMap;
})();
