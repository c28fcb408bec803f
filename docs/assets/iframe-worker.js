// Browsers allow no workers on pages that are opened from the file system. The search then runs in a hidden
// frame, which takes and sends messages as its worker would.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const frame = document.createElement("iframe")
      frame.hidden = true
      this.ready = new Promise(resolve => {
        const begin = () => {
          document.body.append(frame)
          const inside = frame.contentWindow
          inside.postMessage = data => this.dispatchEvent(new MessageEvent("message", { data }))
          inside.importScripts = (...urls) =>
            urls.reduce((before, next) => before.then(() => load(inside, next)), Promise.resolve())
          load(inside, url).then(() => resolve(inside))
        }
        document.body ? begin() : addEventListener("DOMContentLoaded", begin)
      })
    }

    postMessage(data) {
      this.ready.then(inside => inside.dispatchEvent(new MessageEvent("message", { data })))
    }

    terminate() {
      this.ready.then(inside => inside.frameElement.remove())
    }
  }

  function load(inside, url) {
    return new Promise((resolve, reject) => {
      const script = inside.document.createElement("script")
      script.src = new URL(url, location.href)
      script.onload = resolve
      script.onerror = reject
      inside.document.head.append(script)
    })
  }
}
