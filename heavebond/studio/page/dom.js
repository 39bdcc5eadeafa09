// Elements of the page, made of text only: nothing is ever read as markup.

/** @param {string} tag @param {Record<string, any>} [given] @param {...(Node|string|null|undefined|false)} children */
export function el(tag, given = {}, ...children) {
  const made = /** @type {any} */ (document.createElement(tag));
  for (const [name, value] of Object.entries(given)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name === "value" || name === "checked" || name === "disabled") made[name] = value;
    else made.setAttribute(name, value === true ? "" : String(value));
  }
  made.append(...children.filter((child) => child !== null && child !== undefined && child !== false));
  return made;
}

/** @param {string} id @returns {HTMLElement} */
export const byId = (id) => /** @type {HTMLElement} */ (document.getElementById(id));

/** A number to so many digits, without a tail of zeros. @param {number} value */
export function number(value, digits = 5) {
  if (!Number.isFinite(value)) return "—";
  if (value === 0) return "0";
  const plain = Number(value.toPrecision(digits)), size = Math.abs(plain);
  return size >= 1e-4 && size < 1e7 ? String(plain) : plain.toExponential();
}

/** A text with units as they are printed: m/s² for m/s**2. @param {string} text */
export function unitLabel(text) { return text.replace(/\*\*(-?[0-9])/g, (_, n) => [...n].map((c) => c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(c)]).join("")).replace(/(?<=[\w²³])\*(?=\w)/g, "·"); }

/** A message with what stands between backticks as code. @param {string} text @returns {(Node|string)[]} */
export function message(text) { return text.split("`").map((piece, k) => k % 2 ? el("code", {}, piece) : piece); }

/** Hand a file to the browser's downloads. @param {string} name @param {Blob} blob */
export function download(name, blob) {
  const link = el("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.getAttribute("href") ?? ""), 10_000);
}

/** A form that is at work: its main button waits, and is not pressed twice. @param {HTMLElement} form @param {() => Promise<void>} act */
export async function busy(form, act) {
  const button = /** @type {HTMLButtonElement|null} */ (form.querySelector("menu button.main"));
  if (button?.disabled) return;
  const words = button?.textContent ?? "";
  if (button) Object.assign(button, { disabled: true, textContent: "Working…" });
  try { await act(); }
  finally { if (button) Object.assign(button, { disabled: false, textContent: words }); }
}

/** Ask for a name; `act` is tried with it, and what it throws is shown. What it returns is done once the dialog has gone. @param {string} title @param {string} words @param {string} first @param {(name: string) => Promise<void|(() => any)>} act @param {string} [button] @param {Node} [more] further fields, below the name */
export function askName(title, words, first, act, button = "Make", more = undefined) {
  const dialog = /** @type {HTMLDialogElement} */ (byId("ask")), form = /** @type {HTMLFormElement} */ (dialog.querySelector("form"));
  const input = el("input", { id: "ask-name", value: first, spellcheck: "false", autocomplete: "off" });
  const wrong = el("p", { class: "wrong", role: "alert" });
  form.replaceChildren(el("b", {}, title), el("br"), el("label", { for: "ask-name" }, words), input, ...(more ? [more] : []), wrong,
    el("menu", {}, el("button", { type: "button", onclick: () => dialog.close() }, "Cancel"), el("button", { class: "main" }, button)));
  form.onsubmit = (event) => {
    event.preventDefault();
    void busy(form, async () => {
      try {
        const then = await act(/** @type {HTMLInputElement} */ (input).value.trim());
        dialog.close();
        then?.();
      } catch (error) {
        wrong.textContent = error instanceof Error ? error.message : String(error);
      }
    });
  };
  dialog.setAttribute("aria-label", title);
  dialog.showModal();
  /** @type {HTMLInputElement} */ (input).select();
}
