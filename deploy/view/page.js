"use strict";
// Says how the page stands until Bokeh draws it. All else is Bokeh's, and the report's script.
(() => {
  const LONG_MS = 10_000;
  const opening = document.getElementById("opening");
  const wait = () => {
    if (window.Bokeh?.documents.length) opening.remove();
    else if (performance.now() < LONG_MS) setTimeout(wait, 50);
    else opening.textContent = "The page's server does not answer. The run may have ended; if not, load the page again.";
  };
  wait();
})();
