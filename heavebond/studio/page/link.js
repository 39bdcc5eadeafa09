// The socket to the studio's server: questions with answers, and what the server tells by itself.

/** @typedef {{id?: number, kind?: string, push?: string, problems?: any[], series?: Float64Array[], [key: string]: any}} Message */

export class Refused extends Error {
  /** @param {any[]} problems */
  constructor(problems) {
    super(problems.map((p) => p.hint ? `${p.message}\n${p.hint}` : p.message).join("\n\n"));
    this.problems = problems;
  }
}

export class Link {
  /** @param {(message: Message) => void} onpush @param {(open: boolean) => void} onstate */
  constructor(onpush, onstate) {
    this.onpush = onpush;
    this.onstate = onstate;
    this.count = 0;
    /** @type {Map<number, {resolve: (m: Message) => void, reject: (e: Error) => void}>} */
    this.waiting = new Map();
    this.ready = this.connect();
  }

  connect() {
    const address = new URL("socket", location.href);
    address.protocol = "ws:";
    const socket = this.socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.receive(event.data);
    socket.onclose = () => {
      for (const { reject } of this.waiting.values()) reject(new Error("The studio has ended."));
      this.waiting.clear();
      this.onstate(false);
      setTimeout(() => { this.ready = this.connect(); }, 1500);
    };
    return new Promise((resolve) => { socket.onopen = () => { resolve(undefined); this.onstate(true); }; });
  }

  /** @param {string|ArrayBuffer} data */
  receive(data) {
    const message = typeof data === "string" ? JSON.parse(data) : unpacked(data);
    if (message.push) { this.onpush(message); return; }
    const waiting = this.waiting.get(message.id);
    this.waiting.delete(message.id);
    if (message.kind === "problems") waiting?.reject(new Refused(message.problems));
    else waiting?.resolve(message);
  }

  /** @param {string} what @param {Record<string, any>} [given] @returns {Promise<Message>} */
  async ask(what, given = {}) {
    if (this.socket?.readyState !== WebSocket.OPEN) throw new Error("The studio has ended. Start it again; this page stays as it is.");
    const id = ++this.count;
    const answer = new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
    this.socket.send(JSON.stringify({ id, do: what, ...given }));
    return /** @type {Promise<Message>} */ (answer);
  }
}

/** JSON behind its length, then rows of float64. @param {ArrayBuffer} data @returns {Message} */
function unpacked(data) {
  const length = new DataView(data).getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const [rows, n] = message.shape;
  message.series = Array.from({ length: rows }, (_, k) => new Float64Array(data, 4 + length + 8 * n * k, n));
  return message;
}
