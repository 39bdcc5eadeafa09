"use strict";
// A machine in space: the solids of a motion, drawn by three.js, with a camera that the user turns, moves and follows with.
(() => {
  // edge, face and pale face, as in animation.css
  const COLOURS = {
    grey: ["#47525e", "#cfd6dc", "#e8ecef"], dark: ["#263238", "#5d6a75", "#cfd6dc"], blue: ["#00507f", "#6fb1d8", "#d7e8f3"],
    sea: ["#3c86b8", "#9cc9e4", "#dceefa"], gas: ["#8a3570", "#cf8fbc", "#f3dfec"], oil: ["#005a9c", "#8fb9db", "#d6e6f2"],
    rock: ["#6b5a3d", "#b5a280", "#e6dcc8"], red: ["#c2410c", "#f0a37f", "#ffe3d1"], green: ["#00714f", "#7cc4a9", "#dcf1e9"],
    orange: ["#a35a00", "#f0b866", "#fbe8cc"],
  };
  const SOLIDS = ["box", "sphere", "disc", "mesh"], FLAT = ["ground", "level", "trace"];
  const RUNS = ["blue", "red", "green", "gas", "orange", "dark"]; // colours of the runs that are overlaid
  const TURNS = 8, STEPS = 16, SIDES = 6; // coils of a spring, points of a coil, corners of its wire
  const FIELD = 32; // angle of the camera's view in degrees
  const STEP = 0.12; // rad by which an arrow key turns the camera, and the share of its distance by which it moves
  const KEYS = "arrow keys turn the camera, with Shift they move it, plus and minus zoom, 0 shows the whole machine";

  const element = (tag, attributes, ...content) => {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name === "onclick" || name === "onchange") made[name] = value;
      else made.setAttribute(name, value);
    }
    made.append(...content);
    return made;
  };

  class SpaceScene {
    /** The colour of an overlaid run. @param {number} k its number, from 0 */
    static runColour(k) { return COLOURS[RUNS[k % RUNS.length]][0]; }

    /** @param place an empty element with a height @param tools an element for the buttons @param data `packed` motion, with
     * other runs of the same or a similar machine under `runs`, which are translucent */
    constructor(place, tools, data) {
      Object.assign(this, { place, tools, data, frame: 0, followed: "" });
      this.frames = data.times[2];
      place.classList.add("space");
      try {
        this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
      } catch {
        place.replaceChildren(element("p", { role: "alert", class: "missing" }, "This browser shows no pictures in space: it has no WebGL, or WebGL is switched off."));
        return;
      }
      this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
      this.canvas = this.renderer.domElement;
      for (const [name, value] of [["tabindex", "0"], ["role", "application"], ["aria-label", `the machine in motion: ${KEYS}`], ["title", "Drag to turn, with the right button to move, wheel to zoom"]]) this.canvas.setAttribute(name, value);
      this.scene = new THREE.Scene();
      this.camera = new THREE.PerspectiveCamera(FIELD, 1, 0.1, 100);
      this.camera.up.set(0, 0, 1);
      this.scene.add(new THREE.HemisphereLight(0xffffff, 0xb4bac1, 0.78));
      const lamp = new THREE.DirectionalLight(0xffffff, 0.42);
      lamp.position.set(0.45, -0.7, 1);
      this.scene.add(lamp);
      this.controls = new THREE.OrbitControls(this.camera, this.canvas);
      this.controls.addEventListener("change", () => this.draw());
      this.canvas.addEventListener("keydown", event => this.key(event));
      place.replaceChildren(this.canvas);
      const runs = data.runs ?? [], corners = [data, ...runs].map(({ edges }) => edges);
      this.low = new THREE.Vector3(...[0, 1, 2].map(i => Math.min(...corners.map(edges => edges[i]))));
      this.high = new THREE.Vector3(...[3, 4, 5].map(i => Math.max(...corners.map(edges => edges[i]))));
      this.solids = data.solids.map(solid => this.build(solid, data, 0));
      runs.forEach((run, k) => this.solids.push(...run.solids.filter(({ kind }) => !["ground", "level"].includes(kind))
        .map(solid => this.build({ ...solid, colour: RUNS[k % RUNS.length], label: "" }, run, k + 1))));
      this.buttons();
      this.observer = new ResizeObserver(() => this.resize());
      this.observer.observe(place);
      this.resize();
      this.whole();
    }

    dispose() {
      this.observer?.disconnect();
      this.controls?.dispose();
      this.renderer?.dispose();
      this.renderer?.forceContextLoss();
    }

    // -- what is drawn --------------------------------------------------------------------------------------------------
    material(colour, more = {}) { return new THREE.MeshLambertMaterial({ color: colour, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1, ...more }); }

    /** @param solid its data @param film the run that moves it @param run number of an overlaid run, 0 for the first one */
    build(solid, film, run) {
      const [edge, face, pale] = COLOURS[solid.colour], group = new THREE.Group(), found = { solid, group, parts: {}, film, run };
      const mesh = (name, geometry, colour, more) => {
        found.parts[name] = new THREE.Mesh(geometry, this.material(colour, run ? { transparent: true, opacity: 0.45, ...more } : more));
        group.add(found.parts[name]);
      };
      const outline = geometry => group.add(new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 30), new THREE.LineBasicMaterial({ color: edge })));
      const bar = (sides, top = 0.5) => new THREE.CylinderGeometry(top, 0.5, 1, sides).rotateX(Math.PI / 2).translate(0, 0, 0.5); // along z from 0 to 1
      if (solid.kind === "box") {
        mesh("body", new THREE.BoxGeometry(1, 1, 1), face);
        outline(found.parts.body.geometry);
      } else if (solid.kind === "sphere") {
        mesh("body", new THREE.SphereGeometry(0.5, 32, 20), face);
      } else if (solid.kind === "disc") {
        mesh("body", new THREE.CylinderGeometry(0.5, 0.5, 1, 48).rotateX(Math.PI / 2), face);
        outline(found.parts.body.geometry);
        const spokes = new THREE.BufferGeometry();
        spokes.setAttribute("position", new THREE.BufferAttribute(new Float32Array([0, 0, 0.5, 0.5, 0, 0.5, 0, 0, -0.5, 0.5, 0, -0.5]), 3));
        group.add(new THREE.LineSegments(spokes, new THREE.LineBasicMaterial({ color: edge })));
      } else if (solid.kind === "mesh") {
        const corners = new THREE.BufferGeometry();
        corners.setAttribute("position", new THREE.BufferAttribute(new Float32Array(solid.faces.corners), 3));
        corners.setIndex(solid.faces.triangles);
        const flat = corners.toNonIndexed();
        flat.computeVertexNormals();
        mesh("body", flat, face, { side: THREE.DoubleSide });
      } else if (solid.kind === "beam" || solid.kind === "line") {
        mesh("body", bar(24), solid.kind === "line" ? edge : face);
      } else if (solid.kind === "cylinder" || solid.kind === "damper") {
        mesh("body", bar(28), face);
        mesh("rod", bar(20), pale);
      } else if (solid.kind === "arrow") {
        mesh("body", bar(16), edge);
        mesh("head", bar(20, 0), edge);
      } else if (solid.kind === "spring") {
        const wire = new THREE.BufferGeometry(), points = TURNS * STEPS + 1, index = [];
        wire.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points * SIDES * 3), 3));
        for (let i = 0; i + 1 < points; i++) {
          for (let j = 0; j < SIDES; j++) {
            const a = i * SIDES + j, b = i * SIDES + (j + 1) % SIDES;
            index.push(a, b, a + SIDES, b, b + SIDES, a + SIDES);
          }
        }
        wire.setIndex(index);
        mesh("body", wire, edge, { side: THREE.DoubleSide });
        found.parts.body.frustumCulled = false;
      } else if (solid.kind === "trace") {
        const frames = film.times[2], points = new Float32Array(frames * 3), way = new THREE.BufferGeometry();
        for (let k = 0; k < frames; k++) solid.courses.at.forEach((course, i) => { points[3 * k + i] = this.follow(course, k, 0, film); });
        way.setAttribute("position", new THREE.BufferAttribute(points, 3));
        found.parts.way = new THREE.Line(way, new THREE.LineBasicMaterial({ color: edge }));
        found.parts.way.frustumCulled = false;
        group.add(found.parts.way);
      } else if (solid.kind === "level") {
        mesh("body", new THREE.PlaneGeometry(1, 1), face, { transparent: true, opacity: 0.45, side: THREE.DoubleSide, depthWrite: false });
      } else if (solid.kind === "ground") {
        const width = this.follow(solid.courses.size[0], 0, 0, film), ten = 10 ** Math.floor(Math.log10(width / 10));
        const cell = ten * ([1, 2, 5].find(n => width / (n * ten) <= 10) ?? 10), most = Math.floor(width / 2 / cell * (1 + 1e-9)), half = most * cell, lines = [];
        for (let k = -most; k <= most; k++) lines.push(k * cell, -half, 0, k * cell, half, 0, -half, k * cell, 0, half, k * cell, 0);
        if (!this.rule) this.rule = this.place.appendChild(element("div", { class: "rule" }, `squares of ${+cell.toPrecision(3)} m`));
        const grid = new THREE.BufferGeometry();
        grid.setAttribute("position", new THREE.BufferAttribute(new Float32Array(lines), 3));
        group.add(new THREE.LineSegments(grid, new THREE.LineBasicMaterial({ color: edge, transparent: true, opacity: 0.45 })));
      }
      this.scene.add(group);
      if (solid.label) found.label = this.place.appendChild(element("div", { class: "label" }, solid.label));
      return found;
    }

    /** A course between frame k and the next: a number, or the track that it follows and its offset. */
    follow(course, k, part, film) {
      if (typeof course === "number") return course;
      const track = film.tracks[course[0]];
      return course[1] + track[k] + part * ((track[k + 1] ?? track[k]) - track[k]);
    }

    /** Show the machine at a frame, which may lie between two. */
    show(frame) {
      if (!this.renderer) return;
      const before = this.centre(this.followed);
      this.frame = frame;
      for (const found of this.solids) {
        const { solid, group, parts, film } = found, [k, part] = this.instant(film);
        const get = name => solid.courses[name].map(course => this.follow(course, k, part, film));
        if (SOLIDS.includes(solid.kind)) {
          const [w, x, y, z] = get("turn");
          group.position.set(...get("at"));
          group.quaternion.set(x, y, z, w).normalize();
          group.scale.set(...get("size"));
        } else if (solid.kind === "trace") {
          const [lasting] = get("duration"), [begin, end, frames] = film.times, rate = (frames - 1) / (end - begin || 1);
          const first = lasting > 0 ? Math.max(0, Math.ceil(k - lasting * rate)) : 0;
          parts.way.geometry.setDrawRange(first, k + 1 - first);
        } else if (solid.kind === "ground") {
          group.position.set(...get("at"));
        } else if (solid.kind === "level") {
          const [width, depth] = get("size");
          group.position.set(...get("at"));
          group.scale.set(width, depth, 1);
        } else {
          this.bar(found, new THREE.Vector3(...get("from")), new THREE.Vector3(...get("to")), get("width")[0], solid.courses.length ? get("length")[0] : 0);
        }
      }
      const after = this.centre(this.followed);
      if (before && after) {
        this.camera.position.add(after).sub(before);
        this.controls.target.add(after).sub(before);
      }
      this.draw();
    }

    /** The frame of a run at the present time and the part of the next one; a run that is over stays at its end. */
    instant(film) {
      const [begin, end, frames] = film.times, [first, last] = this.data.times;
      const time = first + (last - first) * this.frame / (this.frames - 1 || 1);
      const frame = film === this.data ? this.frame : Math.max(0, Math.min(frames - 1, (time - begin) / (end - begin || 1) * (frames - 1)));
      const k = Math.max(0, Math.min(Math.floor(frame), frames - 1));
      return [k, frame - k];
    }

    bar(found, from, to, width, barrel) {
      const { solid, group, parts } = found, along = to.clone().sub(from), length = along.length();
      group.visible = length > 1e-9 && !this.isHidden(found);
      if (!(length > 1e-9)) return;
      group.position.copy(from);
      group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), along.divideScalar(length));
      if (solid.kind === "beam") parts.body.scale.set(width, width, length);
      else if (solid.kind === "line") parts.body.scale.set(0.18 * width, 0.18 * width, length);
      else if (solid.kind === "spring") this.coil(parts.body.geometry, width, length);
      else if (solid.kind === "arrow") {
        const head = Math.min(3.5 * width, length);
        parts.body.scale.set(0.6 * width, 0.6 * width, Math.max(1e-9, length - head));
        parts.head.scale.set(2 * width, 2 * width, head);
        parts.head.position.set(0, 0, length - head);
      } else {
        const pot = Math.min(barrel, length), rod = (solid.kind === "cylinder" ? 0.45 : 0.25) * width;
        parts.body.scale.set(width, width, Math.max(1e-9, pot));
        parts.rod.scale.set(rod, rod, Math.max(1e-9, length - pot));
        parts.rod.position.set(0, 0, pot);
      }
    }

    /** The wire of a spring of a width along z from 0 to a length. */
    coil(geometry, width, length) {
      const place = geometry.attributes.position, wire = 0.09 * width;
      for (let i = 0, n = 0; i <= TURNS * STEPS; i++) {
        const angle = 2 * Math.PI * i / STEPS, c = Math.cos(angle), s = Math.sin(angle), z = wire + (length - 2 * wire) * i / (TURNS * STEPS);
        for (let j = 0; j < SIDES; j++, n++) {
          const around = 2 * Math.PI * j / SIDES, r = width / 2 - wire + wire * Math.cos(around);
          place.setXYZ(n, r * c, r * s, z + wire * Math.sin(around));
        }
      }
      place.needsUpdate = true;
      geometry.computeVertexNormals();
    }

    /** The middle of a solid at the present frame. */
    centre(name) {
      const found = name && this.solids.find(({ solid }) => solid.name === name);
      if (!found) return null;
      const [k, part] = this.instant(found.film);
      const point = key => new THREE.Vector3(...found.solid.courses[key].map(course => this.follow(course, k, part, found.film)));
      return found.solid.courses.from ? point("from").add(point("to")).multiplyScalar(0.5) : point("at");
    }

    // -- the camera -----------------------------------------------------------------------------------------------------
    resize() {
      const { clientWidth: width, clientHeight: height } = this.place;
      if (!width || !height) return;
      this.renderer.setSize(width, height);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
      this.draw();
    }

    /** The whole machine from the direction that the view gives. */
    whole() {
      const [azimuth, elevation] = this.data.camera, radius = this.low.distanceTo(this.high) / 2 || 1;
      const back = new THREE.Vector3(Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation));
      const right = new THREE.Vector3(-Math.sin(azimuth), Math.cos(azimuth), 0), up = back.clone().cross(right);
      const middle = this.low.clone().add(this.high).multiplyScalar(0.5), high = Math.tan(FIELD * Math.PI / 360), wide = high * this.camera.aspect;
      // so far away that all corners of the box around the machine are in the picture, with their middle in its middle
      const corners = [0, 1, 2, 3, 4, 5, 6, 7].map(i => new THREE.Vector3(...["x", "y", "z"].map((axis, k) => (i >> k & 1 ? this.high : this.low)[axis])));
      let far = 0;
      for (let round = 0; round < 4; round++) {
        const off = corners.map(corner => corner.clone().sub(middle));
        far = Math.max(...off.map(p => p.dot(back) + 1.06 * Math.max(Math.abs(p.dot(right)) / wide, Math.abs(p.dot(up)) / high)));
        for (const axis of [right, up]) {
          const seen = off.map(p => p.dot(axis) / (far - p.dot(back)));
          middle.addScaledVector(axis, far * (Math.max(...seen) + Math.min(...seen)) / 2);
        }
      }
      this.controls.target.copy(middle);
      this.camera.position.copy(middle).addScaledVector(back, far || radius);
      this.camera.near = radius / 200;
      this.camera.far = radius * 60;
      this.camera.updateProjectionMatrix();
      this.controls.update();
      this.draw();
    }

    /** The camera, the followed body and the hidden arrows and traces of another scene of the same machine. */
    lookAs(other) {
      if (!this.renderer || !other.renderer) return;
      this.controls.target.copy(other.controls.target);
      this.camera.position.copy(other.camera.position);
      this.controls.update();
      const [select] = this.tools.getElementsByTagName("select");
      select.value = other.followed;
      this.followed = select.value; // empty if there is no such body
      for (const kind of other.hidden) this.tools.querySelector(`[data-kind="${kind}"]`)?.click();
    }

    key(event) {
      const turns = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      const zoom = { "+": 1 / 1.15, "=": 1 / 1.15, "-": 1.15 }[event.key];
      if (event.ctrlKey || event.altKey || event.metaKey || !(turns || zoom || event.key === "0")) return;
      event.preventDefault();
      event.stopPropagation();
      if (event.key === "0") { this.whole(); return; }
      const { target } = this.controls, off = this.camera.position.clone().sub(target);
      if (zoom) off.multiplyScalar(zoom);
      else if (event.shiftKey) {
        const right = new THREE.Vector3(0, 0, 1).cross(off).normalize(), up = off.clone().cross(right).normalize();
        target.addScaledVector(right, turns[0] * STEP * off.length()).addScaledVector(up, -turns[1] * STEP * off.length());
      } else {
        const far = off.length(), azimuth = Math.atan2(off.y, off.x) + turns[0] * -STEP;
        const elevation = Math.max(-1.55, Math.min(1.55, Math.asin(off.z / far) + turns[1] * STEP));
        off.set(Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation)).multiplyScalar(far);
      }
      this.camera.position.copy(target).add(off);
      this.controls.update();
      this.draw();
    }

    /** Draw once before the browser shows the next picture. */
    draw() {
      if (this.asked || !this.solids) return;
      this.asked = true;
      requestAnimationFrame(() => { this.asked = false; this.drawNow(); });
    }

    drawNow() {
      this.renderer.render(this.scene, this.camera);
      for (const { label, solid } of this.solids) {
        if (!label) continue;
        const { x, y, z } = this.centre(solid.name).project(this.camera);
        label.hidden = z > 1 || Math.abs(x) > 1 || Math.abs(y) > 1;
        label.style.left = `${(50 + 50 * x).toFixed(2)}%`;
        label.style.top = `${(50 - 50 * y).toFixed(2)}%`;
      }
    }

    // -- the buttons ----------------------------------------------------------------------------------------------------
    isHidden({ solid, run }) { return (this.hidden?.has(solid.kind) || this.hidden?.has(`run ${run}`)) ?? false; }

    buttons() {
      this.hidden = new Set();
      const named = this.solids.filter(({ run }) => !run).map(({ solid }) => solid).filter(solid => !FLAT.includes(solid.kind));
      const select = element("select", { "aria-label": "follow a body", title: "The camera moves with a body", onchange: event => { this.followed = event.target.value; } },
        element("option", { value: "" }, "fixed camera"), ...named.map(solid => element("option", { value: solid.name }, `follow ${solid.label || solid.name}`)));
      const box = (kind, text) => {
        if (!kind.startsWith("run ") && !this.solids.some(({ solid }) => solid.kind === kind)) return [];
        const input = element("input", { type: "checkbox", "data-kind": kind, onchange: () => this.reveal(kind, input.checked) });
        input.checked = true;
        return [element("label", {}, input, ` ${text}`)];
      };
      const runs = (this.data.runs ?? []).map((run, k) => {
        const [label] = box(`run ${k + 1}`, run.label);
        label.style.color = SpaceScene.runColour(k);
        return label;
      });
      this.tools.replaceChildren(
        element("button", { type: "button", title: "Show the whole machine (0)", onclick: () => this.whole() }, "Whole machine"), select,
        ...box("arrow", "arrows"), ...box("trace", "traces"), ...runs,
        element("button", { type: "button", title: "Save the present picture as a PNG file", onclick: () => this.save() }, "PNG"));
    }

    reveal(kind, shown) {
      if (shown) this.hidden.delete(kind);
      else this.hidden.add(kind);
      for (const found of this.solids) found.group.visible = !this.isHidden(found);
      this.show(this.frame);
    }

    /** The present picture on white, with its labels. */
    picture() {
      this.drawNow(); // the browser keeps a drawing until the end of this task
      const made = element("canvas", { width: this.canvas.width, height: this.canvas.height }), pen = made.getContext("2d");
      const scale = this.canvas.width / (this.place.clientWidth || 1);
      pen.fillStyle = "#fff";
      pen.fillRect(0, 0, made.width, made.height);
      pen.drawImage(this.canvas, 0, 0);
      pen.fillStyle = "#1d2733";
      pen.font = `${13 * scale}px Helvetica, Arial, sans-serif`;
      pen.textAlign = "center";
      if (this.rule) {
        pen.textAlign = "left";
        pen.fillText(this.rule.textContent, 8 * scale, made.height - 8 * scale);
        pen.textAlign = "center";
      }
      for (const { label } of this.solids) {
        if (label && !label.hidden) pen.fillText(label.textContent, parseFloat(label.style.left) / 100 * made.width, parseFloat(label.style.top) / 100 * made.height - 6 * scale);
      }
      return made;
    }

    save() {
      this.picture().toBlob(blob => {
        const link = element("a", { href: URL.createObjectURL(blob), download: `${this.data.title || "machine"}.png` });
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 10000);
      }, "image/png");
    }
  }
  window.SpaceScene = SpaceScene;
})();
