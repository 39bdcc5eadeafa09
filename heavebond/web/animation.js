"use strict";
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const id = name => document.getElementById(name);
  const data = JSON.parse(id("motion").textContent);
  const [begin, end, frames] = data.times;
  const make = (parent, tag, attributes, text) => {
    const found = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) found.setAttribute(name, value);
    if (text !== undefined) found.textContent = text;
    return parent.appendChild(found);
  };
  // the value of a course between frame k and the next
  const at = (course, k, part) => course[k] + part * ((k + 1 < frames ? course[k + 1] : course[k]) - course[k]);
  // a place of a shape: a number, or the track that it follows and how far off it is
  const follow = (course, k, part) => typeof course === "number" ? course : course[1] + at(data.tracks[course[0]], k, part);

  // -- shapes: y upwards in m, so that the picture is y downwards
  const plane = () => {
    const [left, bottom, right, top] = data.edges;
    const stage = make(id("stage"), "svg", {viewBox: `${left} ${-top} ${right - left} ${top - bottom}`, role: "img"});
    const letter = Math.max((top - bottom) / 34, (right - left) / 62);
    const shapes = data.shapes.map(shape => {
      const group = make(stage, "g", {class: `shape ${shape.colour}`, id: `shape-${shape.name}`});
      make(group, "title", {}, shape.label || shape.name);
      const paths = shape.outlines.map(o => make(group, "path", {class: `${o.fill} ${o.edge || "bare"}`}));
      return {shape, paths};
    });
    // writing lies over all shapes
    for (const found of shapes) {
      if (found.shape.label) found.label = make(stage, "text", {"font-size": letter}, found.shape.label);
    }
    const place = ({shape, paths, label}, k, part) => {
      const [x, y, u, v, width, barrel] = shape.courses.map(course => follow(course, k, part));
      const length = Math.hypot(u - x, v - y) || 1e-12, dx = (u - x) / length, dy = (v - y) / length;
      shape.outlines.forEach((outline, i) => {
        const corners = outline.corners.map(([a, b, w]) => {
          const s = a * length + b * barrel, n = w * width;
          return `${(x + s * dx - n * dy).toFixed(5)} ${(-(y + s * dy + n * dx)).toFixed(5)}`;
        });
        paths[i].setAttribute("d", "M" + corners.join("L"));
      });
      if (!label) return;
      const ground = shape.kind === "ground", across = ["level", "mark"].includes(shape.kind);
      const room = (ground || shape.kind === "box") && label.getComputedTextLength() < length && letter < width;
      label.setAttribute("text-anchor", room ? "middle" : across ? "end" : "start");
      label.setAttribute("x", room ? (x + u) / 2 : across ? right - letter / 2
        : Math.max(x, u) + (Math.abs(dy) > 0.5 ? width / 2 : 0) + letter / 2);
      label.setAttribute("y", ground ? -y + width / 2 + 0.35 * letter : across ? -y - letter / 3 : -(y + v) / 2 + 0.35 * letter);
    };
    // a length to compare with: about a fifth of the height, a round number
    const tens = 10 ** Math.floor(Math.log10((top - bottom) / 4)), rule = tens * [5, 2, 1].find(n => n * tens <= (top - bottom) / 4);
    const ruler = make(stage, "g", {class: "ruler"});
    make(ruler, "path", {d: `M${left + letter} ${-top + letter}h${letter / 2}M${left + letter} ${-top + letter + rule}h${letter / 2}M` +
      `${left + 1.25 * letter} ${-top + letter}v${rule}`});
    make(ruler, "text", {x: left + 1.8 * letter, y: -top + 1.35 * letter + rule / 2, "font-size": 0.9 * letter}, `${+rule.toPrecision(3)} m`);
    return (k, part) => shapes.forEach(shape => place(shape, k, part));
  };
  const inSpace = () => {
    const scene = new window.SpaceScene(id("stage"), id("camera"), data);
    window.scene = scene;
    return (k, part) => scene.show(k + part);
  };
  const machine = data.solids ? inSpace() : plane();

  // -- signals over time, with a line at the present instant
  const wide = 952, high = 84, inset = 130;
  const print = value => Math.abs(value) >= 1e5 || (value && Math.abs(value) < 1e-3) ? value.toExponential(2) : +value.toPrecision(4);
  const courses = data.signals.map(signal => {
    const values = signal.values, others = (data.runs ?? []).flatMap((run, k) => run.signals.filter(other => other.name === signal.name && other.unit === signal.unit).map(other => [run, other.values, k]));
    const all = [values, ...others.map(([, other]) => other)].flat(), low = Math.min(...all), reach = Math.max(...all) - low || 1;
    const svg = make(id("courses"), "svg", {viewBox: `0 0 ${wide} ${high}`});
    make(svg, "rect", {x: inset, y: 4, width: wide - inset, height: high - 8});
    const x = k => inset + (wide - inset) * k / (values.length - 1), y = value => high - 8 - (high - 16) * (value - low) / reach;
    for (const [run, other, k] of others) {
      const [first, last, count] = run.times, across = k => x((first + (last - first) * k / (count - 1) - begin) / (end - begin || 1) * (values.length - 1));
      make(svg, "path", {d: "M" + other.map((value, i) => `${across(i).toFixed(1)} ${y(value).toFixed(1)}`).join("L")}).style.stroke = window.SpaceScene.runColour(k);
    }
    make(svg, "path", {d: "M" + values.map((value, k) => `${x(k).toFixed(1)} ${y(value).toFixed(1)}`).join("L")});
    make(svg, "text", {x: 0, y: 16, "font-weight": "bold"}, signal.name);
    make(svg, "text", {x: inset - 6, y: 16, "text-anchor": "end", class: "quiet"}, print(low + reach));
    make(svg, "text", {x: inset - 6, y: high - 8, "text-anchor": "end", class: "quiet"}, print(low));
    return {signal, line: make(svg, "line", {y1: 4, y2: high - 4}), now: make(svg, "text", {x: 0, y: 36})};
  });

  // -- time
  const slider = id("when"), play = id("play"), speed = id("speed");
  let frame = 0, running = false, before = 0;
  const show = () => {
    const k = Math.min(Math.floor(frame), frames - 1), part = frame - k, t = begin + (end - begin) * frame / (frames - 1);
    machine(k, part);
    courses.forEach(({signal, line, now}) => {
      const x = inset + (wide - inset) * frame / (frames - 1);
      line.setAttribute("x1", x);
      line.setAttribute("x2", x);
      now.textContent = `${print(at(signal.values, k, part))} ${signal.unit}`;
    });
    slider.value = frame;
    id("clock").textContent = `${t.toFixed(end - begin < 20 ? 2 : 1)} s`;
  };
  const step = now => {
    if (!running) return;
    frame += (now - before) / 1000 * Number(speed.value) * (frames - 1) / (end - begin);
    before = now;
    if (frame > frames - 1) frame = 0;
    show();
    requestAnimationFrame(step);
  };
  const toggle = () => {
    running = !running;
    play.textContent = running ? "Pause" : "Play";
    before = performance.now();
    if (running) requestAnimationFrame(step);
  };
  play.addEventListener("click", toggle);
  slider.addEventListener("input", () => { frame = Number(slider.value); show(); });
  document.addEventListener("keydown", event => {
    if (event.key === " " && (event.target === document.body || event.target.tagName === "CANVAS")) { event.preventDefault(); toggle(); }
  });
  show();
})();
