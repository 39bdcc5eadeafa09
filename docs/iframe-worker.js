/* Search works in a worker, and browsers start none for a page that was opened from a folder. There a hidden frame does
   the work of it: its script sees what a worker sees, and messages go to and fro through a channel. */
(() => {
  if (location.protocol !== "file:") return;

  // runs in the frame: load the script as soon as the page has sent its end of the channel
  const inside = address => {
    const load = url => new Promise((done, failed) => {
      const script = document.createElement("script");
      Object.assign(script, {src: url, onload: done, onerror: failed});
      document.head.append(script);
    });
    window.importScripts = (...urls) => urls.reduce((before, url) => before.then(() => load(url)), Promise.resolve());
    addEventListener("message", async event => {
      event.stopImmediatePropagation();
      const [port] = event.ports;
      window.postMessage = data => port.postMessage(data);
      await load(address);
      port.onmessage = ({data}) => dispatchEvent(new MessageEvent("message", {data}));
    }, {once: true});
  };

  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const {port1, port2} = new MessageChannel();
      const frame = document.createElement("iframe");
      const address = new URL(url, location.href).href;
      this.port = port1;
      this.terminate = () => frame.remove();
      port1.onmessage = ({data}) => this.dispatchEvent(new MessageEvent("message", {data}));
      frame.hidden = true;
      frame.srcdoc = `<!doctype html><script>(${inside})(${JSON.stringify(address)})</` + "script>";
      frame.addEventListener("load", () => frame.contentWindow.postMessage("", "*", [port2]), {once: true});
      document.documentElement.append(frame);
    }

    postMessage(data) {
      this.port.postMessage(data);
    }
  };
})();
