// The grid of the drawing: which column and row a point means, and the lines that show them while something is dragged.

const SVG = "http://www.w3.org/2000/svg";
const WIDE = 130, HIGH = 90; // px from the last column and row to a new one

/** The column or row that a coordinate means: k on it, k + 0.5 between two, -1 and n beyond them. @param {number[]} places @param {number} value @param {number} beyond */
function nearest(places, value, beyond) {
  if (!places.length) return 0;
  if (value < places[0] - beyond / 2) return -1;
  if (value > places[places.length - 1] + beyond / 2) return places.length;
  let k = 0;
  for (let j = 1; j < places.length; j++) if (Math.abs(places[j] - value) < Math.abs(places[k] - value)) k = j;
  const other = value > places[k] ? k + 1 : k - 1;
  if (other < 0 || other >= places.length) return k;
  const share = Math.abs(value - places[k]) / Math.abs(places[other] - places[k]);
  return share > 0.36 ? (k + other) / 2 : k;
}

/** Where such a column stands. @param {number[]} places @param {number} k @param {number} beyond */
function coordinate(places, k, beyond) {
  if (!places.length) return 0;
  if (k < 0) return places[0] - beyond;
  if (k > places.length - 1) return places[places.length - 1] + beyond;
  return (places[Math.floor(k)] + places[Math.ceil(k)]) / 2;
}

/** The cell for a point; a cell where another part stands is left for the row next to it. @param {any} grid @param {number} x @param {number} y @param {string} [part] which is moved */
export function cellAt(grid, x, y, part) {
  const xs = grid?.xs ?? [], ys = grid?.ys ?? [], cells = grid?.cells ?? {};
  let column = nearest(xs, x, WIDE), row = nearest(ys, y, HIGH);
  const own = part && cells[part];
  if (own) { // between its own column, where nothing else stands, and the next is no other place
    const alone = (/** @type {number} */ axis) => Object.entries(cells).every(([name, cell]) => name === part || cell[axis] !== own[axis]);
    if (Math.abs(column - own[0]) === 0.5 && alone(0)) column = own[0];
    if (Math.abs(row - own[1]) === 0.5 && alone(1)) row = own[1];
  }
  const there = Object.entries(cells).find(([name, cell]) => name !== part && cell[0] === column && cell[1] === row);
  if (there) row = y < ys[row] ? (row === 0 ? -1 : row - 0.5) : row === ys.length - 1 ? ys.length : row + 0.5;
  return { column, row, same: Boolean(own) && own[0] === column && own[1] === row,
    x: coordinate(xs, column, WIDE), y: coordinate(ys, row, HIGH) };
}

/** A free cell for a part that is placed by the keyboard: right of a part, below it, else below all. @param {any} grid @param {string} [beside] */
export function freeCell(grid, beside) {
  const cells = grid?.cells ?? {}, taken = new Set(Object.values(cells).map(String));
  const [c, r] = cells[beside ?? ""] ?? [-1, (grid?.ys?.length ?? 0)];
  if (!beside || !cells[beside]) return { column: 0, row: r };
  for (const [column, row] of [[c + 1, r], [c, r + 1], [c - 1, r], [c, r - 1]]) if (!taken.has(String([column, row]))) return { column, row };
  return { column: c, row: r + 0.5 };
}

/** Lines through a cell. @param {any} svg */
export class Guides {
  /** @param {any} svg */
  constructor(svg) {
    this.group = document.createElementNS(SVG, "g");
    this.group.setAttribute("class", "guides");
    this.lines = [0, 1].map(() => this.group.appendChild(document.createElementNS(SVG, "path")));
    svg?.append(this.group);
  }

  /** @param {{x: number, y: number}} cell */
  show(cell) {
    this.lines[0].setAttribute("d", `M${cell.x} -20000 V20000`);
    this.lines[1].setAttribute("d", `M-20000 ${cell.y} H20000`);
  }

  end() { this.group.remove(); }
}
