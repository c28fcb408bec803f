/** The list of keys. */

import { h, iconButton } from "./dom";
import { KEYS } from "./keys";

export function helpDialog(): HTMLDialogElement {
  const rows = KEYS.map(([keys, , text]) =>
    h("div", { class: "key-row" }, h("kbd", {}, keys), h("span", {}, text)),
  );
  const dialog = h("dialog", { class: "help", "aria-label": "keys" });
  dialog.append(
    h(
      "header",
      {},
      h("h2", {}, "Keys"),
      iconButton("close", "Close", () => dialog.close(), "esc"),
    ),
    h("div", { class: "keys-table" }, ...rows),
  );
  dialog.addEventListener("click", (event) => {
    if (event.target === dialog) dialog.close();
  });
  return dialog;
}
