"use strict";
// Says how the page stands until Bokeh draws it, and shows the texts that come with its figures.
window.live = {};
(() => {
  const LONG_MS = 10_000;
  const at = (id) => document.getElementById(id);
  const put = (id, markup) => { if (at(id).dataset.shown !== markup) at(id).innerHTML = at(id).dataset.shown = markup; };
  // a busy machine may draw late: what was said then goes again
  const wait = () => {
    if (window.Bokeh?.documents.length) return at("opening").remove();
    const isLong = performance.now() >= LONG_MS;
    if (isLong) put("opening", "The page's server does not answer. The run may have ended; if not, load the page again.");
    setTimeout(wait, isLong ? 500 : 50);
  };
  wait();

  let words = null, isOver = false, isFetched = false;
  at("arm").addEventListener("change", () => { words.chosen = at("arm").value; });

  window.live.show = (model) => {
    words = model;
    if (isOver !== words.is_over) {
      isOver = words.is_over;
      window.live.say?.();
    }
    if (words.is_alone && !document.body.classList.contains("alone")) {
      document.body.classList.add("alone");
      const way = at("way").options;
      [way[1].text, way[2].text] = ["forward (west to east)", "feedback (east to west)"];
    }
    for (const id of ["sides", "figures", "state"]) put(id, words[id]);
    put("arm", words.arms.map((arm) => `<option${arm === words.shown ? " selected" : ""}>${arm}</option>`).join(""));
    at("arms").hidden = words.arms.length < 2;
    if (!words.is_reported || isFetched) return;
    isFetched = true;
    fetch("report").then((answer) => answer.ok ? answer.blob() : null).then((page) => {
      if (page === null) return;
      at("report").querySelector("a").href = URL.createObjectURL(page);  // kept by the browser: the server ends with the run
      at("report").hidden = false;
    }, () => {});  // the server is gone; the path of the report is on the page
  };
  window.live.lose = (model) => {
    isOver = model.is_over;
    at("lost").hidden = isOver;
    window.live.say?.();
  };
  window.live.isOver = () => isOver;
})();
