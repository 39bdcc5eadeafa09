// The drawing as a file: SVG, PNG or PDF.

import { download, el } from "./dom.js";

const SHARP = 2; // pixels of a PNG picture per unit of the drawing

/** @param {any} studio @param {string} format */
export async function savePicture(studio, format) {
  const { svg, name } = studio.view ?? {};
  if (!svg || !format) return;
  const file = String(name).replace(/\W+/g, "_");
  if (format === "svg") { download(`${file}.svg`, new Blob([svg], { type: "image/svg+xml" })); return; }
  if (format === "pdf") {
    const told = await studio.link.ask("picture", studio.runs.question({}));
    download(`${file}.pdf`, new Blob([Uint8Array.from(atob(told.pdf), (c) => c.charCodeAt(0))], { type: "application/pdf" }));
    return;
  }
  const image = /** @type {HTMLImageElement} */ (el("img", { src: `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}` }));
  await image.decode();
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: SHARP * image.naturalWidth, height: SHARP * image.naturalHeight });
  /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d")).drawImage(image, 0, 0, canvas.width, canvas.height);
  canvas.toBlob((blob) => blob && download(`${file}.png`, blob));
}
