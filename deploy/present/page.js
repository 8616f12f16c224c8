"use strict";
// Light and dark, names that hide and show, one part at a time, and paper. All else is Bokeh's.
(() => {
  const tones = JSON.parse(document.getElementById("tones").textContent);
  const to = { dark: new Map(tones), light: new Map(tones.map(([light, dark]) => [dark, light])) };
  const system = matchMedia("(prefers-color-scheme: dark)");
  const button = document.getElementById("theme");
  let chosen = null;

  const scheme = () => chosen ?? (system.matches ? "dark" : "light");
  const models = () => (window.Bokeh?.documents ?? []).flatMap((doc) => [...doc._all_models.values()]);

  const paint = (name) => {
    for (const model of models()) {
      for (const property in model.properties) {
        if (!property.endsWith("_color")) continue;
        const value = model[property];
        const tone = to[name].get(value?.value ?? value);
        // how a page looks is its own business: a live page's server is not told
        if (tone) model.setv({ [property]: value.value ? { ...value, value: tone } : tone }, { sync: false });
      }
    }
  };
  const apply = () => {
    document.documentElement.style.colorScheme = document.documentElement.dataset.scheme = scheme();
    button.textContent = scheme() === "dark" ? "Light page" : "Dark page";
    paint(scheme());
  };

  button.hidden = false;
  button.addEventListener("click", () => { chosen = scheme() === "dark" ? "light" : "dark"; apply(); });
  system.addEventListener("change", apply);

  document.addEventListener("click", (event) => {
    const pressed = event.target.closest("[data-series]");
    if (!pressed) return;
    const name = pressed.dataset.series;
    const shown = pressed.getAttribute("aria-pressed") !== "true";
    for (const other of document.querySelectorAll("[data-series]")) {
      if (other.dataset.series === name) other.setAttribute("aria-pressed", shown);
    }
    for (const model of models()) if (model.name === name && "visible" in model) model.visible = shown;
  });

  const bar = document.querySelector(".switch");
  const show = (part) => {
    for (const one of document.querySelectorAll("[data-of]")) one.hidden = part !== "" && one.dataset.of !== part;
    for (const one of bar.children) one.setAttribute("aria-pressed", one.dataset.part === part);
  };
  if (bar) {
    bar.hidden = false;
    bar.addEventListener("click", (event) => { if ("part" in event.target.dataset) show(event.target.dataset.part); });
    show(bar.firstElementChild.dataset.part);
  }

  // A printer waits for nobody: figures are scaled instead of laid out again, and dark ones inverted by the style.
  const ALONE_PX = 450, BESIDE_PX = 330;  // of the 690 px that a page of A4 is wide
  addEventListener("beforeprint", () => {
    for (const one of document.querySelectorAll("#requirements > details")) one.open = true;
    for (const plots of document.querySelectorAll(".plots")) {
      const room = plots.closest(".figures") ? BESIDE_PX : ALONE_PX;
      const width = plots.offsetWidth;
      if (!width) continue;
      plots.style.setProperty("--own", `${width}px`);
      plots.style.setProperty("--fit", room / width);
    }
  });

  apply();
  const wait = () => (models().length ? apply() : requestAnimationFrame(wait));
  addEventListener("DOMContentLoaded", () => { if (window.Bokeh) wait(); });  // a live page loads it beside the rest
})();
