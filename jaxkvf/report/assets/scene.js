// Arrays and the 3-D picture. Uses three.js.

const decoded = (text, Type) => new Type(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
const unscaled = ({ most, parts }) => Float32Array.from(decoded(parts, Int16Array), (n) => (n * most) / 32767);
const norms = (vectors) =>
  Float32Array.from({ length: vectors.length / 3 }, (_, i) => Math.hypot(vectors[3 * i], vectors[3 * i + 1], vectors[3 * i + 2]));
const largest = (values) => values.reduce((a, b) => Math.max(a, b), 0);

const INK = 0x1a1a21;
const FIELD_OF_VIEW = 28;
const SECONDS = 9; // that a period takes on the screen
const ARROW = { reach: 1.35, lift: 0.07, shaft: 0.026, head: 0.075, headLength: 0.28, headShare: 0.45, floor: 0.015 };

/** One surface in a scene of its own; what is drawn of a field is made when it is first looked at. */
class ShownMesh {
  constructor(told, faces, frame) {
    this.told = told;
    this.faces = faces;
    this.positions = decoded(told.vertices, Float32Array);
    this.fields = told.fields.map((field) => {
      const vectors = unscaled(field.vectors);
      return { ...field, vectors, speeds: norms(vectors), strains: unscaled(field.strains), flow: null };
    });
    this.scene = new THREE.Scene();
    this.group = new THREE.Group();
    this.group.scale.setScalar(frame.scale);
    this.group.position.copy(frame.center).multiplyScalar(-frame.scale);
    this.scene.add(this.group, new THREE.HemisphereLight(0xffffff, 0xd8d4ce, 0.72));
    this.makeMesh();
    this.makeArrows();
  }

  /** Drawn with a copy of each vertex for each smooth part around it, so that creases are seen. */
  makeMesh() {
    const copied = decoded(this.told.drawn.copied, Uint32Array);
    const given = this.positions.length / 3;
    this.origins = Uint32Array.from({ length: given + copied.length }, (_, i) => (i < given ? i : copied[i - given]));
    const positions = Float32Array.from({ length: 3 * this.origins.length }, (_, i) => this.positions[3 * this.origins[(i / 3) | 0] + (i % 3)]);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
    geometry.setIndex(new THREE.BufferAttribute(decoded(this.told.drawn.faces, Uint32Array), 1));
    geometry.computeVertexNormals();
    this.colors = new THREE.BufferAttribute(new Float32Array(positions.length), 3);
    geometry.setAttribute("color", this.colors);
    const offset = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 };
    const material = new THREE.MeshStandardMaterial({ vertexColors: true, roughness: 0.8, side: THREE.DoubleSide, ...offset });
    const thin = new THREE.MeshBasicMaterial({ color: INK, wireframe: true, transparent: true, opacity: 0.16 });
    this.edges = new THREE.Mesh(geometry, thin);
    this.group.add(new THREE.Mesh(geometry, material), this.edges);
  }

  makeArrows() {
    const { faces, weights } = this.told.arrows;
    this.places = { faces: decoded(faces, Uint32Array), weights: decoded(weights, Float32Array) };
    const count = this.places.faces.length;
    const material = new THREE.MeshLambertMaterial({ color: INK });
    const shaft = new THREE.CylinderGeometry(ARROW.shaft, ARROW.shaft, 1, 10).translate(0, 0.5, 0);
    const head = new THREE.ConeGeometry(ARROW.head, ARROW.headLength, 12).translate(0, ARROW.headLength / 2, 0);
    this.shafts = new THREE.InstancedMesh(shaft, material, count);
    this.heads = new THREE.InstancedMesh(head, material, count);
    this.shafts.frustumCulled = this.heads.frustumCulled = false;
    this.group.add(this.shafts, this.heads);
  }

  /** Colours the vertices by values from 0 to most. */
  paint(values, most, map) {
    this.origins.forEach((origin, i) => {
      const entry = 3 * Math.max(0, Math.min(255, Math.round((255 * values[origin]) / (most || 1))));
      for (let c = 0; c < 3; c++) this.colors.array[3 * i + c] = map[entry + c] / 255;
    });
    this.colors.needsUpdate = true;
  }

  /** Arrows of a field, centred at their places, as long as it is fast there. */
  pointAlong(field) {
    const { faces, weights } = this.places;
    const [point, vector, normal, one, two] = Array.from({ length: 5 }, () => new THREE.Vector3());
    const spacing = this.told.arrows.spacing;
    const top = largest(field.speeds) || 1;
    const upward = new THREE.Vector3(0, 1, 0);
    const turn = new THREE.Quaternion();
    const matrix = new THREE.Matrix4();
    const at = (array, i, into) => into.fromArray(array, 3 * i);
    faces.forEach((face, n) => {
      point.set(0, 0, 0);
      vector.set(0, 0, 0);
      const corners = this.faces.subarray(3 * face, 3 * face + 3);
      corners.forEach((corner, c) => {
        point.addScaledVector(at(this.positions, corner, one), weights[3 * n + c]);
        vector.addScaledVector(at(field.vectors, corner, one), weights[3 * n + c]);
      });
      at(this.positions, corners[0], normal);
      one.fromArray(this.positions, 3 * corners[1]).sub(normal);
      two.fromArray(this.positions, 3 * corners[2]).sub(normal);
      normal.crossVectors(one, two).normalize();
      const share = vector.length() / top;
      const length = share < ARROW.floor ? 0 : ARROW.reach * spacing * share;
      const thick = spacing * Math.min(1, (ARROW.headShare * length) / (ARROW.headLength * spacing));
      vector.normalize();
      turn.setFromUnitVectors(upward, vector);
      point.addScaledVector(normal, ARROW.lift * spacing).addScaledVector(vector, -length / 2);
      const neck = length - ARROW.headLength * thick;
      this.shafts.setMatrixAt(n, matrix.compose(point, turn, one.set(thick, neck, thick)));
      point.addScaledVector(vector, neck);
      this.heads.setMatrixAt(n, matrix.compose(point, turn, one.set(thick, thick, thick)));
    });
    this.shafts.instanceMatrix.needsUpdate = this.heads.instanceMatrix.needsUpdate = true;
  }

  /** Flow lines: thin lines, and dashes that move along them as time does. */
  flowLines({ lines }) {
    const whole = decoded(lines.positions, Uint16Array);
    const ends = [];
    const times = [];
    const coordinate = (i) => lines.origin[i % 3] + (whole[i] / 65535) * lines.reach;
    lines.counts.forEach((count, n) => {
      for (let s = 0; s + 1 < count; s++) {
        const first = 3 * (n * lines.points + s);
        for (let c = 0; c < 6; c++) ends.push(coordinate(first + c));
        times.push((lines.pulses * s) / (lines.points - 1), (lines.pulses * (s + 1)) / (lines.points - 1));
      }
    });
    const geometry = new THREE.LineSegmentsGeometry().setPositions(ends);
    const along = new THREE.InstancedInterleavedBuffer(new Float32Array(times), 2, 1);
    geometry.setAttribute("instanceDistanceStart", new THREE.InterleavedBufferAttribute(along, 1, 0));
    geometry.setAttribute("instanceDistanceEnd", new THREE.InterleavedBufferAttribute(along, 1, 1));
    const faint = new THREE.LineMaterial({ color: INK, linewidth: 1.2, transparent: true, opacity: 0.35 });
    const dashed = new THREE.LineMaterial({ color: INK, linewidth: 2.6, dashSize: 0.3, gapSize: 0.7 });
    dashed.dashed = true;
    const flow = new THREE.Group();
    flow.add(...[faint, dashed].map((material) => new THREE.LineSegments2(geometry, material)));
    flow.materials = [faint, dashed];
    flow.pulses = lines.pulses;
    this.group.add(flow);
    return flow;
  }

  show(index, { draw, edges }) {
    const field = this.fields[index];
    if (draw === "lines" || draw === "both") field.flow ??= this.flowLines(field);
    this.fields.forEach(({ flow }, i) => {
      if (flow) flow.visible = i === index && (draw === "lines" || draw === "both");
    });
    const arrows = draw === "arrows" || draw === "both";
    if (arrows) this.pointAlong(field);
    this.shafts.visible = this.heads.visible = arrows;
    this.edges.visible = edges;
    this.flow = field.flow;
  }

  /** Moves the dashes to where they are after so many periods. */
  advance(periods) {
    if (this.flow) this.flow.materials[1].dashOffset = -((periods * this.flow.pulses) % 1e4);
  }
}

/** The canvas: surfaces side by side, seen by one camera that the pointer moves. */
class Stage {
  constructor(canvas, surfaces, view) {
    this.canvas = canvas;
    this.surfaces = surfaces;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setClearColor(0xf6f6f4);
    this.renderer.setScissorTest(true);
    this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.05, 100);
    const light = new THREE.DirectionalLight(0xffffff, 0.42);
    light.position.set(-0.4, 0.7, 1);
    this.camera.add(light);
    this.light = light;
    this.stale = true;
    this.lookFrom(view);
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
  }

  lookFrom([direction, up]) {
    this.camera.up.set(...up);
    this.camera.position.set(...direction);
    this.moved = false;
    this.controls?.dispose();
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("start", () => (this.moved = true));
    this.controls.addEventListener("change", () => (this.stale = true));
    this.controls.minDistance = 0.5;
    this.controls.maxDistance = 20;
    this.resize();
  }

  /** How far the camera must stand to see every vertex, along its direction, with a margin. */
  distance() {
    const back = this.camera.position.clone().normalize();
    const right = new THREE.Vector3().crossVectors(this.camera.up, back).normalize();
    const up = new THREE.Vector3().crossVectors(back, right);
    const slope = 0.84 * Math.tan((FIELD_OF_VIEW / 2) * (Math.PI / 180));
    const point = new THREE.Vector3();
    let far = 0;
    for (const { positions, group } of this.surfaces) {
      for (let i = 0; i < positions.length; i += 3) {
        point.fromArray(positions, i).multiply(group.scale).add(group.position);
        const reach = Math.max(Math.abs(point.dot(up)), Math.abs(point.dot(right)) / this.camera.aspect);
        far = Math.max(far, point.dot(back) + reach / slope);
      }
    }
    return far;
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / this.surfaces.length / height;
    this.camera.updateProjectionMatrix();
    if (!this.moved) this.camera.position.setLength(this.distance());
    this.render(); // at once: a canvas of another size is black until it is drawn
  }

  render() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    const share = width / this.surfaces.length;
    this.surfaces.forEach((surface, i) => {
      this.renderer.setViewport(i * share, 0, share, height);
      this.renderer.setScissor(i * share, 0, share, height);
      surface.flow?.materials.forEach((material) => material.resolution.set(share, height));
      surface.scene.add(this.camera);
      this.renderer.render(surface.scene, this.camera);
    });
    this.stale = false;
  }
}
