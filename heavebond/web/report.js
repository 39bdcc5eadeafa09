// Records beside models: zoom, pan, read off. Draws every figure[data-chart] from the JSON block `series`; nothing is
// fetched and nothing is evaluated. A stretch of time is shared by the charts of one record.
"use strict";
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const LEFT = 62, RIGHT = 14, TOP = 20, UPPER = 190, GAP = 28, LOWER = 78, BOTTOM = 24;
  const NEAR = 6; // px between samples from which on they are drawn as dots

  // deltas of integers, in quanta
  const unpack = (packed) => {
    const found = new Float64Array(packed.d.length);
    let sum = 0;
    packed.d.forEach((d, i) => { sum += d; found[i] = packed.o + sum * packed.q; });
    return found;
  };

  const make = (name, attributes, parent, text) => {
    const node = document.createElementNS(NS, name);
    for (const key of Object.keys(attributes)) node.setAttribute(key, attributes[key]);
    if (text !== undefined) node.textContent = text;
    parent.appendChild(node);
    return node;
  };

  // steps of 1, 2, 5 times a power of ten
  const ticks = (low, high, most) => {
    const rough = (high - low) / Math.max(1, most);
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((k) => k * power >= rough * 0.999);
    const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
      const large = Math.abs(k * step) >= 1e6 || (step < 1e-4 && k !== 0);
      found.push([k * step, large ? (k * step).toExponential(2) : (k * step).toFixed(decimals)]);
    }
    return found;
  };

  const shortest = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(5))) : "-");

  // the first sample not before t
  const bisect = (time, t) => {
    let low = 0, high = time.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (time[middle] < t) low = middle + 1; else high = middle;
    }
    return low;
  };

  // a line through the samples first .. last - 1; of many in one pixel only the first, lowest, highest and last are drawn
  const path = (time, values, breaks, first, last, x, y) => {
    let d = "", pen = "M", column = NaN, low = 0, high = 0, end = 0;
    const put = (px, value) => { d += pen + px.toFixed(1) + " " + y(value).toFixed(1); pen = "L"; };
    const flush = () => {
      if (Number.isNaN(column)) return;
      if (high > low) { put(column + 0.5, low); put(column + 0.5, high); }
      put(column + 0.5, end);
    };
    const dense = last - first > 2 * (x(time[last - 1]) - x(time[first]));
    for (let i = first; i < last; i += 1) {
      if (!dense) {
        put(x(time[i]), values[i]);
      } else {
        const here = Math.floor(x(time[i]));
        if (here !== column) {
          flush();
          column = here;
          put(here + 0.5, values[i]);
          low = values[i];
          high = values[i];
        }
        low = Math.min(low, values[i]);
        high = Math.max(high, values[i]);
        end = values[i];
      }
      if (breaks.has(i)) { flush(); column = NaN; pen = "M"; }
    }
    flush();
    return d;
  };

  const dots = (time, values, indices, x, y) =>
    indices.map((i) => `M${x(time[i]).toFixed(1)} ${y(values[i]).toFixed(1)}h0`).join("");

  const reach = (arrays, first, last) => {
    let low = Infinity, high = -Infinity;
    for (const values of arrays) {
      for (let i = first; i < last; i += 1) {
        if (values[i] < low) low = values[i];
        if (values[i] > high) high = values[i];
      }
    }
    if (!(high >= low)) return [-1, 1];
    const room = 0.06 * (high - low) || 0.1 * Math.abs(high) || 1;
    return [low - room, high + room];
  };

  class Chart {
    constructor(figure, data, group) {
      this.data = data;
      this.group = group;
      this.time = unpack(data.time);
      this.measured = unpack(data.measured);
      this.models = data.models.map((m) => ({ ...m, values: unpack(m.values), left: null }));
      for (const m of this.models) m.left = this.measured.map((v, i) => v - m.values[i]);
      this.breaks = new Set(data.breaks);
      this.readout = figure.querySelector("output");
      this.svg = make("svg", { class: "series", role: "img", tabindex: "0", "aria-label": data.label },
        figure.querySelector(".canvas"));
      this.svg.addEventListener("pointermove", (event) => this.hover(event));
      this.svg.addEventListener("pointerleave", () => this.read(-1));
      this.cursor = -1;
    }

    // the last model has a panel of its own, in which its rest is seen beside the noise
    get alone() { return this.models.length > 1 && this.group.shown.has(this.models[this.models.length - 1].label); }

    get height() { return TOP + UPPER + (this.alone ? 2 : 1) * (GAP + LOWER) + BOTTOM; }

    get width() { return Math.max(280, this.svg.parentNode.clientWidth); }

    x(t) {
      const [from, to] = this.group.span;
      return LEFT + (t - from) / (to - from) * (this.width - LEFT - RIGHT);
    }

    t(px) {
      const [from, to] = this.group.span;
      return from + (px - LEFT) / (this.width - LEFT - RIGHT) * (to - from);
    }

    draw() {
      const svg = this.svg, width = this.width, [from, to] = this.group.span;
      svg.setAttribute("viewBox", `0 0 ${width} ${this.height}`);
      svg.setAttribute("height", this.height);
      svg.setAttribute("data-from", from);
      svg.setAttribute("data-to", to);
      while (svg.firstChild) svg.firstChild.remove();
      const first = Math.max(0, bisect(this.time, from) - 1), last = Math.min(this.time.length, bisect(this.time, to) + 1);
      const shown = this.models.filter((m) => this.group.shown.has(m.label));
      const clip = `clip-${this.data.id}`;
      const box = make("clipPath", { id: clip }, make("defs", {}, svg));
      make("rect", { x: LEFT, y: 0, width: width - LEFT - RIGHT, height: this.height }, box);
      const inside = make("g", { "clip-path": `url(#${clip})` }, svg);
      this.held(inside);
      const upper = this.panel(svg, TOP, UPPER, reach([this.measured, ...shown.map((m) => m.values)], first, last), 5);
      const lower = TOP + UPPER + GAP, again = lower + LOWER + GAP;
      this.rest(svg, clip, lower, shown, first, last, "record − model");
      if (this.alone) this.rest(svg, clip, again, this.models.slice(-1), first, last, "record − last model");
      this.lines(make("g", { "clip-path": `url(#${clip})` }, svg), shown, first, last, upper);
      this.axis(svg, width);
      this.write(svg, TOP - 7, `${this.data.channel} [${this.data.unit}]`);
      this.cursorLine = make("line", { class: "cursor", y1: TOP, y2: this.height - BOTTOM, x1: -9, x2: -9 }, svg);
      this.selection = make("rect",
        { class: "selection", y: TOP, height: this.height - TOP - BOTTOM, x: -9, width: 0 }, svg);
    }

    held(parent) {
      for (const [a, b] of this.data.held) {
        make("rect", { class: "held", x: this.x(a), width: Math.max(0, this.x(b) - this.x(a)), y: TOP,
          height: this.height - TOP - BOTTOM }, parent);
      }
    }

    // what models miss, on the band of the noise
    rest(svg, clip, top, shown, first, last, title) {
      const band = this.data.band, [low, high] = reach(shown.map((m) => m.left), first, last);
      const size = shown.length ? Math.max(Math.abs(low), Math.abs(high), 1.3 * band) : 2 * band;
      const back = make("g", { "clip-path": `url(#${clip})` }, svg);
      const y = this.panel(svg, top, LOWER, [-size, size], 5);
      make("rect", { class: "noise", x: LEFT, width: this.width - LEFT - RIGHT, y: y(band),
        height: Math.max(1, y(-band) - y(band)) }, back);
      const lines = make("g", { "clip-path": `url(#${clip})` }, svg);
      make("line", { class: "zero", x1: LEFT, x2: this.width - RIGHT, y1: y(0), y2: y(0) }, lines);
      for (const m of shown) {
        make("path", { class: `model m${m.style} left`,
          d: last > first ? path(this.time, m.left, this.breaks, first, last, (t) => this.x(t), y) : "" }, lines);
      }
      this.write(svg, top - 7, `${title} [${this.data.unit}]`);
    }

    write(svg, y, text) { make("text", { class: "name", x: LEFT, y }, svg, text); }

    // the grid of one panel; gives the map from values to px
    panel(svg, top, height, [low, high], most) {
      const y = (value) => top + (high - value) / (high - low) * height;
      for (const [value, text] of ticks(low, high, most)) {
        make("line", { class: "grid", x1: LEFT, x2: this.width - RIGHT, y1: y(value), y2: y(value) }, svg);
        make("text", { class: "tick", x: LEFT - 6, y: y(value) + 4, "text-anchor": "end" }, svg, text);
      }
      make("line", { class: "axis", x1: LEFT, x2: LEFT, y1: top, y2: top + height }, svg);
      return y;
    }

    lines(parent, shown, first, last, upper) {
      const x = (t) => this.x(t);
      if (last <= first) return;
      const apart = (x(this.time[last - 1]) - x(this.time[first])) / Math.max(1, last - first);
      const indices = Array.from({ length: last - first }, (_, k) => first + k);
      make("path", apart > NEAR ? { class: "record dots", d: dots(this.time, this.measured, indices, x, upper) } :
        { class: "record", d: path(this.time, this.measured, this.breaks, first, last, x, upper) }, parent);
      for (const m of shown) {
        make("path", { class: `model m${m.style}`, d: path(this.time, m.values, this.breaks, first, last, x, upper) }, parent);
      }
      const astray = this.data.outliers.filter((i) => i >= first && i < last);
      make("path", { class: "outlier", d: astray.map((i) => {
        const px = x(this.time[i]), py = upper(this.measured[i]);
        return `M${px - 4} ${py - 4}l8 8m0 -8l-8 8`;
      }).join("") }, parent);
    }

    axis(svg, width) {
      const base = this.height - BOTTOM;
      make("line", { class: "axis", x1: LEFT, x2: width - RIGHT, y1: base, y2: base }, svg);
      for (const [value, text] of ticks(...this.group.span, Math.min(9, width / 90))) {
        make("line", { class: "axis", x1: this.x(value), x2: this.x(value), y1: base, y2: base + 4 }, svg);
        if (this.x(value) < width - 60) {
          make("text", { class: "tick", x: this.x(value), y: base + 16, "text-anchor": "middle" }, svg, text);
        }
      }
      make("text", { class: "tick", x: width - RIGHT, y: base + 16, "text-anchor": "end" }, svg, "time [s]");
    }

    place(event) {
      const box = this.svg.getBoundingClientRect();
      return (event.clientX - box.left) * this.width / box.width;
    }

    hover(event) {
      const t = this.t(this.place(event)), right = bisect(this.time, t);
      const left = Math.max(0, right - 1);
      const i = right < this.time.length && this.time[right] - t < t - this.time[left] ? right : left;
      this.group.charts.forEach((chart) => chart.read(bisect(chart.time, this.time[i] - 1e-12)));
    }

    // the values at one sample
    read(i) {
      const inside = i >= 0 && i < this.time.length && this.cursorLine;
      if (this.cursorLine) {
        this.cursorLine.setAttribute("x1", inside ? this.x(this.time[i]) : -9);
        this.cursorLine.setAttribute("x2", inside ? this.x(this.time[i]) : -9);
      }
      this.readout.textContent = !inside ? "" : [`${shortest(this.time[i])} s`, `record ${shortest(this.measured[i])}`,
        ...this.models.filter((m) => this.group.shown.has(m.label))
          .map((m) => `${m.label} ${shortest(m.values[i])}`)].join("  |  ");
    }

    select(a, b) {
      this.selection.setAttribute("x", Math.min(a, b));
      this.selection.setAttribute("width", Math.abs(a - b));
    }
  }

  // the charts of one record, which show one stretch of time
  class Group {
    constructor(section, record) {
      this.whole = record.span;
      this.span = [...record.span];
      this.shown = new Set(record.shown);
      this.charts = [...section.querySelectorAll("figure[data-chart]")].map((figure) =>
        new Chart(figure, record.charts[Number(figure.dataset.chart)], this));
      this.pointers = new Map();
      this.charts.forEach((chart) => this.listen(chart));
      for (const button of section.querySelectorAll("button[data-do]")) {
        button.addEventListener("click", () => this.act(button.dataset.do));
      }
      for (const button of section.querySelectorAll("button[data-model]")) {
        button.addEventListener("click", () => this.toggle(button));
      }
      new ResizeObserver(() => this.draw()).observe(section);
      this.draw();
    }

    draw() { this.charts.forEach((chart) => chart.draw()); }

    toggle(button) {
      const label = button.dataset.model, on = !this.shown.has(label);
      if (on) this.shown.add(label); else this.shown.delete(label);
      button.setAttribute("aria-pressed", String(on));
      this.draw();
    }

    show(from, to) {
      const [first, last] = this.whole, least = (last - first) * 1e-4;
      const length = Math.min(Math.max(to - from, least), last - first);
      const begin = Math.min(Math.max(from, first), last - length);
      this.span = [begin, begin + length];
      this.draw();
    }

    zoom(factor, at) {
      const [from, to] = this.span, middle = at === undefined ? (from + to) / 2 : at;
      this.show(middle - (middle - from) * factor, middle + (to - middle) * factor);
    }

    move(share) {
      const [from, to] = this.span, by = share * (to - from);
      this.show(from + by, to + by);
    }

    act(what) {
      const acts = { in: () => this.zoom(0.5), out: () => this.zoom(2), back: () => this.move(-0.25),
        on: () => this.move(0.25), whole: () => this.show(...this.whole) };
      acts[what]();
    }

    listen(chart) {
      const svg = chart.svg;
      const keys = { "+": "in", "=": "in", "-": "out", ArrowLeft: "back", ArrowRight: "on", "0": "whole", Escape: "whole" };
      svg.addEventListener("keydown", (event) => {
        if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
        event.preventDefault();
        this.act(keys[event.key]);
      });
      // the wheel belongs to the page until the chart was clicked
      svg.addEventListener("wheel", (event) => {
        if (document.activeElement !== svg && !event.ctrlKey) return;
        event.preventDefault();
        this.zoom(1.0015 ** event.deltaY, chart.t(chart.place(event)));
      }, { passive: false });
      svg.addEventListener("dblclick", () => this.act("whole"));
      svg.addEventListener("pointerdown", (event) => this.press(chart, event));
      svg.addEventListener("pointermove", (event) => this.drag(chart, event));
      for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, (event) => this.release(chart, event));
    }

    press(chart, event) {
      if (event.button > 1) return;
      svgFocus(chart.svg);
      chart.svg.setPointerCapture(event.pointerId);
      const px = chart.place(event);
      this.pointers.set(event.pointerId, { from: px, to: px });
      this.panning = event.pointerType === "touch" || event.shiftKey || event.button === 1;
      this.pressed = [...this.span];
      for (const p of this.pointers.values()) p.from = p.to;
    }

    drag(chart, event) {
      const pointer = this.pointers.get(event.pointerId);
      if (!pointer) return;
      pointer.to = chart.place(event);
      const [from, to] = this.pressed, per = (to - from) / (chart.width - LEFT - RIGHT);
      const all = [...this.pointers.values()];
      if (all.length === 2) {
        const [a, b] = all, old = Math.abs(a.from - b.from) || 1, now = Math.abs(a.to - b.to) || 1;
        const at = from + ((a.from + b.from) / 2 - LEFT) * per, factor = old / now;
        this.show(at - (at - from) * factor, at + (to - at) * factor);
      } else if (this.panning) {
        const by = (pointer.from - pointer.to) * per;
        this.show(from + by, to + by);
      } else {
        chart.select(pointer.from, pointer.to);
      }
    }

    release(chart, event) {
      const pointer = this.pointers.get(event.pointerId);
      if (!pointer) return;
      this.pointers.delete(event.pointerId);
      for (const p of this.pointers.values()) p.from = p.to;
      const [a, b] = [pointer.from, pointer.to].sort((one, other) => one - other);
      chart.select(-9, -9);
      if (!this.panning && event.type === "pointerup" && b - a > 5) this.show(chart.t(a), chart.t(b));
      this.pressed = [...this.span];
    }
  }

  const svgFocus = (svg) => svg.focus({ preventScroll: true });

  const start = () => {
    const block = document.getElementById("series");
    if (!block) return;
    const records = JSON.parse(block.textContent);
    document.querySelectorAll("section[data-record]").forEach((section) => {
      new Group(section, records[Number(section.dataset.record)]);
    });
    document.documentElement.classList.add("alive");
  };

  // paper shows what is folded away, but for long lists
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((d) => {
      d.dataset.was = String(d.open);
      d.open = d.open || !d.classList.contains("long");
    });
  });
  window.addEventListener("afterprint", () => {
    document.querySelectorAll("details").forEach((d) => { d.open = d.dataset.was === "true"; });
  });
  start();
})();
