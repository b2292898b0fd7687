// Search without a server: a page opened from a file may start no worker, so that an invisible frame does the work.
class FrameWorker extends EventTarget {
  constructor(url) {
    super();
    this.frame = document.createElement("iframe");
    this.frame.hidden = true;
    document.body.appendChild(this.frame);
    const inside = this.frame.contentDocument;
    inside.open();
    inside.write(`<html><body><script>
      var postMessage = parent.postMessage.bind(parent);
      function importScripts(...urls) {
        return urls.reduce((before, url) => before.then(() => new Promise((loaded, failed) => {
          const script = document.createElement("script");
          script.src = url;
          script.onload = loaded;
          script.onerror = failed;
          document.body.appendChild(script);
        })), Promise.resolve());
      }
    </script><script src="${url}"></script></body></html>`);
    inside.close();
    window.addEventListener("message", (event) => {
      if (event.source === this.frame.contentWindow) {
        const message = new MessageEvent("message", { data: event.data });
        this.dispatchEvent(message);
        if (this.onmessage) this.onmessage(message);
      }
    });
  }

  postMessage(data) {
    const deliver = () => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data }));
    if (this.frame.contentDocument.readyState === "complete") deliver();
    else this.frame.addEventListener("load", deliver, { once: true });
  }
}

if (location.protocol === "file:") window.Worker = FrameWorker;
