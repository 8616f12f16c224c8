"use strict";
// The camera's picture as the surgeon's screen shows it. One question at a time: the next when the last is drawn.
(() => {
  const canvas = document.getElementById("seen");
  if (!canvas) return;  // a run without a camera
  const at = (id) => document.getElementById(id);
  const AGAIN_MS = 1000;
  const WORDS = { complete: "It came whole.", concealed: "Damaged: not all came of it, or of what it builds on.",
    torn: "Torn: it is made of two frames." };
  let said = null, drawn = 0, looked = null, came = null, over = false;

  const pause = (ms) => new Promise((done) => setTimeout(done, ms));
  const painted = () => new Promise((done) => requestAnimationFrame(done));  // a hidden page asks for nothing
  const draw = async (answer) => {
    const told = JSON.parse(answer.headers.get("Tis-Picture")), got = performance.now();
    const image = await createImageBitmap(await answer.blob());
    await painted();
    if (canvas.width !== image.width || canvas.height !== image.height) {
      [canvas.width, canvas.height] = [image.width, image.height];
      canvas.style.aspectRatio = image.width / image.height;
    }
    canvas.getContext("2d").drawImage(image, 0, 0);
    image.close();
    [said, drawn] = [told, got];
    at("sight").hidden = false;
    canvas.closest(".drive").classList.add("sees");
  };
  const follow = async () => {
    while (!over) {
      try {
        const answer = await fetch(`picture?after=${said?.number ?? 0}`);
        const [late, since] = ["Tis-Late", "Tis-Came"].map((name) => answer.headers.get(name)), now = performance.now();
        if (late !== null && since !== null) [looked, came] = [now - Number(late), now - Number(since)];
        const never = answer.status === 204 && answer.headers.get("Tis-Picture");
        if (never) return tellNone(JSON.parse(never).needs);
        if (answer.status === 200) await draw(answer);
        else if (!answer.ok) await pause(AGAIN_MS);
      } catch { await pause(AGAIN_MS); }  // the server is gone, as the page says
    }
  };
  const tellNone = (needs) => {
    over = true;
    if (needs) at("sight").hidden = false;
    at("seen_state").textContent = needs ? `No picture here: the package ${needs} is not installed.` : "";
  };

  const { age, silence } = window.pictureLayout;
  const put = (node, text) => { if (node.textContent !== text) node.textContent = text; };
  const tell = () => {
    if (window.live.isOver()) over = true;
    if (!said) return;
    const now = over ? drawn : performance.now(), since = now - drawn;  // after the end nothing counts on
    const silent = over ? null : silence(since, looked === null ? null : now - looked, now - came);
    put(at("seen_age"), said.age_ms == null ? "–" : age(said.age_ms + since));
    const share = `${said.n_whole} of the last ${said.n} frames whole.`;
    at("seen_stamps").hidden = !said.is_stamped;
    const untold = said.is_stamped ? "" : " No stamps: hand to eye and tears are not measured.";
    put(at("seen_state"), silent ? silent.text : `${WORDS[said.state]} ${share}${untold}`);
    canvas.parentElement.dataset.state = silent ? silent.state : said.state;
  };
  window.live.onClose(() => { over = true; });
  // Where the camera looks: away from it is upwards times rightwards.
  if (canvas.dataset.axes) {
    const [r, u] = JSON.parse(canvas.dataset.axes);
    const away = [0, 1, 2].map((i) => u[(i + 1) % 3] * r[(i + 2) % 3] - u[(i + 2) % 3] * r[(i + 1) % 3]);
    window.live.driveOn?.(canvas, () => Number(canvas.dataset.px_per_mm) * canvas.clientWidth / canvas.width, (by) => r.map((_, i) => by[0] * r[i] + by[1] * u[i] + by[2] * away[i]));
  }
  setInterval(tell, 100);
  follow();
})();
