// The map, the trajectory and the current scan in 3D, for the live page and for the report. Needs
// three.js.
//
// Coordinates are doubles until they are near something: surfels are stored relative to the corner
// of their block, everything else relative to `origin`, so that single precision is enough anywhere
// in the world.
(function () {
  'use strict';
  const Lamina = (window.Lamina = window.Lamina || {});

  // A line so many pixels wide, which WebGL alone does not draw: each segment is two triangles that
  // turn with the camera.
  const kLineVertex = `
    attribute vec3 other;  // the segment's other end
    attribute float side;
    uniform vec2 screen;
    uniform float width;
    const float kNear = -0.1;
    // Of a segment that reaches behind the camera, the part before it.
    vec3 before(vec3 a, vec3 b) {
      return a.z > kNear && b.z < kNear ? mix(a, b, (kNear - a.z) / (b.z - a.z)) : a;
    }
    void main() {
      vec3 a = (modelViewMatrix * vec4(position, 1.0)).xyz;
      vec3 b = (modelViewMatrix * vec4(other, 1.0)).xyz;
      vec4 p = projectionMatrix * vec4(before(a, b), 1.0);
      vec4 q = projectionMatrix * vec4(before(b, a), 1.0);
      vec2 along = (q.xy / q.w - p.xy / p.w) * screen;
      vec2 across = vec2(-along.y, along.x) / max(length(along), 1e-6);
      gl_Position = p + vec4(side * width * across / screen * p.w, 0.0, 0.0);
    }`;
  const kLineFragment = `
    uniform vec3 colour;
    void main() { gl_FragColor = vec4(colour, 1.0); }`;

  class WideLine {
    constructor(colour, width, order) {
      this.width = width;
      const material = new THREE.ShaderMaterial({
        uniforms: {
          colour: {value: new THREE.Color(colour)}, width: {value: width},
          screen: {value: new THREE.Vector2(1, 1)},
        },
        vertexShader: kLineVertex, fragmentShader: kLineFragment,
        // Seen through the map, and both sides of it.
        depthTest: false, depthWrite: false, transparent: true, side: THREE.DoubleSide,
      });
      this.mesh = new THREE.Mesh(new THREE.BufferGeometry(), material);
      this.mesh.frustumCulled = false;
      this.mesh.renderOrder = order;
    }

    // `points` are arrays of three.
    set(points) {
      const segments = Math.max(0, points.length - 1);
      const position = new Float32Array(12 * segments), other = new Float32Array(12 * segments);
      const side = new Float32Array(4 * segments), index = new Uint32Array(6 * segments);
      for (let i = 0; i < segments; ++i) {
        const [a, b] = [points[i], points[i + 1]];
        // Seen from its end, a segment's sides are the other way round.
        [[a, b, 1], [a, b, -1], [b, a, -1], [b, a, 1]].forEach(([p, q, s], k) => {
          position.set(p, 12 * i + 3 * k);
          other.set(q, 12 * i + 3 * k);
          side[4 * i + k] = s;
        });
        index.set([0, 1, 2, 2, 1, 3].map((v) => 4 * i + v), 6 * i);
      }
      this.mesh.geometry.dispose();
      const geometry = this.mesh.geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', new THREE.BufferAttribute(position, 3));
      geometry.setAttribute('other', new THREE.BufferAttribute(other, 3));
      geometry.setAttribute('side', new THREE.BufferAttribute(side, 1));
      geometry.setIndex(new THREE.BufferAttribute(index, 1));
    }

    setScreen(size, pixelRatio) {
      this.mesh.material.uniforms.screen.value.copy(size);
      this.mesh.material.uniforms.width.value = this.width * pixelRatio;
    }
  }

  class Viewer {
    // Throws if there is no three.js or no WebGL.
    constructor(canvas) {
      if (!window.THREE || !THREE.OrbitControls) throw new Error('three.js is not installed');
      this.canvas = canvas;
      this.renderer = new THREE.WebGLRenderer({canvas, antialias: true});
      this.renderer.setClearColor(Viewer.background);
      this.scene = new THREE.Scene();
      this.camera = new THREE.PerspectiveCamera(50, 1, 0.1, 5000);
      this.camera.up.set(0, 0, 1);
      this.controls = new THREE.OrbitControls(this.camera, canvas);
      Object.assign(this.controls, {
        enableKeys: false, enableDamping: true, dampingFactor: 0.15, screenSpacePanning: false,
        maxPolarAngle: 0.98 * Math.PI, minDistance: 0.5, maxDistance: 3000, zoomSpeed: 1.2,
      });
      this.controls.addEventListener('change', () => this.invalidate());
      this.map = new Lamina.SurfelMap();
      this.scene.add(this.map.group);
      this.path = new WideLine('#ffd166', 2.5, 3);
      this.truth = new WideLine('#7ee0ff', 1.5, 2);
      this.scene.add(this.path.mesh, this.truth.mesh);
      this.scan = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial(
          {color: '#ffffff', size: 1.6, sizeAttenuation: false, transparent: true, opacity: 0.8}));
      this.scan.frustumCulled = false;
      this.scan.visible = false;
      this.scene.add(this.scan);
      this.sensor = this.addSensor();
      this.surfelSize = 1;
      this.follow = true;
      this.colouring = 'height';
      this.clear();
      canvas.addEventListener('keydown', (event) => this.onKey(event));
      new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
      this.resize();
    }

    addSensor() {
      const cone = new THREE.ConeGeometry(0.35, 1, 16);
      cone.rotateZ(-Math.PI / 2);  // its tip along x, as the sensor looks
      const sensor = new THREE.Mesh(cone, new THREE.MeshBasicMaterial(
          {color: '#ffffff', depthTest: false, transparent: true}));
      sensor.renderOrder = 4;
      sensor.visible = false;
      this.scene.add(sensor);
      return sensor;
    }

    // Back to an empty world, seen from behind and above.
    clear() {
      this.origin = null;
      this.place = null;
      this.map.clear();
      this.path.set([]);
      this.truth.set([]);
      this.scan.visible = false;
      this.sensor.visible = false;
      this.controls.target.set(0, 0, 0);
      this.camera.position.set(-28, -18, 24);
      this.invalidate();
    }

    local(position) {
      if (!this.origin) this.origin = position.map(Math.round);
      return position.map((p, i) => p - this.origin[i]);
    }

    setTrajectory(poses) {
      this.path.set(poses.map((pose) => this.local(pose.position)));
      this.invalidate();
      if (poses.length === 0) return;
      const last = poses[poses.length - 1];
      const at = new THREE.Vector3(...this.local(last.position));
      this.sensor.position.copy(at);
      this.sensor.quaternion.set(...last.quaternion);
      this.sensor.visible = true;
      if (this.follow || !this.place) this.lookAt(at);
      this.place = last.position;
    }

    showPath(shown) {
      this.path.mesh.visible = this.truth.mesh.visible = shown;
      this.invalidate();
    }

    setTruth(poses) {
      this.truth.set(poses.map((pose) => this.local(pose.position)));
      this.invalidate();
    }

    // Moves the camera along, as it stands.
    lookAt(at) {
      const moved = at.clone().sub(this.controls.target);
      this.controls.target.add(moved);
      this.camera.position.add(moved);
      this.invalidate();
    }

    setFollow(follow) {
      this.follow = follow;
      if (follow && this.place) this.lookAt(new THREE.Vector3(...this.local(this.place)));
    }

    // All of the trajectory in sight, from above at a slant.
    showAll(poses) {
      const box = new THREE.Box3();
      for (const pose of poses) box.expandByPoint(new THREE.Vector3(...this.local(pose.position)));
      if (box.isEmpty()) return;
      const ball = box.getBoundingSphere(new THREE.Sphere());
      const away = Math.max(25, 1.25 * ball.radius / Math.tan(this.camera.fov * Math.PI / 360));
      this.controls.target.copy(ball.center);
      this.camera.position.copy(ball.center)
          .add(new THREE.Vector3(-0.55, -0.45, 0.7).normalize().multiplyScalar(away));
      this.invalidate();
    }

    setScan(scan) {
      this.scan.geometry.dispose();
      const geometry = this.scan.geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', new THREE.BufferAttribute(scan.points, 3));
      this.scan.position.set(...this.local(scan.origin));
      this.scan.visible = scan.points.length > 0;
      this.invalidate();
    }

    hideScan() {
      this.scan.visible = false;
      this.invalidate();
    }

    addMap(page) {
      if (!this.origin) this.local([0, 0, 0]);
      this.map.add(page, this.origin);
      this.invalidate();
    }

    // World coordinates of what the camera turns about.
    target() {
      const origin = this.origin || [0, 0, 0];
      return this.controls.target.toArray().map((t, i) => t + origin[i]);
    }

    // Returns the values at both ends of the colours.
    setColouring(id) {
      this.colouring = id;
      this.invalidate();
      return this.map.colour(id);
    }

    setSize(factor) {
      this.surfelSize = factor;
      this.invalidate();
    }

    onKey(event) {
      const turn = 0.08, offset = this.camera.position.clone().sub(this.controls.target);
      const ball = new THREE.Spherical().setFromVector3(
          new THREE.Vector3(offset.x, offset.z, -offset.y));
      const steps = {
        ArrowLeft: () => (ball.theta -= turn), ArrowRight: () => (ball.theta += turn),
        ArrowUp: () => (ball.phi -= turn), ArrowDown: () => (ball.phi += turn),
        '+': () => (ball.radius *= 0.88), '=': () => (ball.radius *= 0.88),
        '-': () => (ball.radius /= 0.88),
      };
      const step = steps[event.key];
      if (!step || event.ctrlKey || event.metaKey || event.altKey) return;
      step();
      ball.phi = Math.min(Math.max(ball.phi, 0.05), 0.97 * Math.PI);
      const moved = new THREE.Vector3().setFromSpherical(ball);
      this.camera.position.copy(this.controls.target)
          .add(new THREE.Vector3(moved.x, -moved.z, moved.y));
      event.preventDefault();
      this.invalidate();
    }

    resize() {
      const {clientWidth: w, clientHeight: h} = this.canvas.parentElement;
      if (w === 0 || h === 0) return;
      this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
      this.renderer.setSize(w, h, false);
      this.camera.aspect = w / h;
      this.camera.updateProjectionMatrix();
      this.invalidate();
    }

    // Draws with the next frame of the screen; nothing is drawn while nothing changes.
    invalidate() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        this.controls.update();
        this.draw();
      });
    }

    draw() {
      for (const block of this.map.blocks.values()) block.upload();
      const uniforms = this.map.material.uniforms;
      const screen = this.renderer.getDrawingBufferSize(new THREE.Vector2());
      for (const line of [this.path, this.truth]) {
        line.setScreen(screen, this.renderer.getPixelRatio());
      }
      uniforms.pixels.value = screen.y / (2 * Math.tan(this.camera.fov * Math.PI / 360));
      uniforms.size.value = this.surfelSize;
      uniforms.height.value = this.origin ? this.origin[2] : 0;
      // As large on the screen wherever it is.
      const away = this.camera.position.distanceTo(this.sensor.position);
      this.sensor.scale.setScalar(Math.max(0.4, 0.025 * away));
      this.renderer.render(this.scene, this.camera);
    }

    // Draws, and counts the pixels that differ from the background.
    countPixels() {
      this.draw();
      const gl = this.renderer.getContext();
      const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight;
      const rgba = new Uint8Array(4 * w * h);
      gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
      const background = new THREE.Color(Viewer.background);
      const back = [background.r, background.g, background.b].map((c) => 255 * c);
      let other = 0;
      for (let i = 0; i < rgba.length; i += 4) {
        if (back.some((b, k) => Math.abs(rgba[i + k] - b) > 8)) ++other;
      }
      return other;
    }
  }
  Viewer.background = '#0d1117';
  Lamina.Viewer = Viewer;

  // Fills the list of colourings and keeps legend and view in step with it. Returns a function that
  // brings the legend up to date when the map has changed.
  Lamina.bindColours = function (viewer, select, legend) {
    for (const colouring of Lamina.colourings) {
      select.add(new Option(colouring.name, colouring.id));
    }
    const [bar, low, high] = ['.bar', '.low', '.high'].map((c) => legend.querySelector(c));
    const update = () => {
      const colouring = Lamina.colourings.find((c) => c.id === select.value);
      const range = viewer ? viewer.setColouring(colouring.id) : [0, 1];
      bar.style.background = 'linear-gradient(90deg,' + colouring.stops.join(',') + ')';
      low.textContent = colouring.label(range[0]);
      high.textContent = colouring.label(range[1]);
    };
    select.addEventListener('change', update);
    update();
    return update;
  };
})();
