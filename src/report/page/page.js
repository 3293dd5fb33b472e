"use strict";
// Films: frames that the page holds, shown by a slider or in their own time. Nothing moves unless it is asked to.
const frames = JSON.parse(document.getElementById("frames").textContent);
for (const film of document.querySelectorAll(".film")) {
  const { times, rows, notes, first } = JSON.parse(film.querySelector("script").textContent);
  const pictures = film.querySelectorAll("img");
  const slider = film.querySelector("input");
  const button = film.querySelector("button");
  const speed = film.querySelector("select");
  const output = film.querySelector("output");
  const lines = film.closest("section").querySelectorAll(".now");
  let playing = null;

  function show(i) {
    rows.forEach((row, r) => { pictures[r].src = "data:image/jpeg;base64," + frames[row[i]]; });
    const text = times[i].toFixed(2) + " s" + (notes[i] && ": " + notes[i]);
    slider.value = i;
    slider.setAttribute("aria-valuetext", text);
    output.value = text;
    for (const line of lines) {
      const { from, to, left, right } = line.dataset;
      const share = (times[i] - from) / (to - from);
      line.setAttribute("visibility", share >= 0 && share <= 1 ? "visible" : "hidden");
      const x = Number(left) + share * (right - left);
      line.setAttribute("x1", x);
      line.setAttribute("x2", x);
    }
  }

  function stop() {
    cancelAnimationFrame(playing);
    playing = null;
    button.textContent = "Play";
  }

  function play() {
    let i = Number(slider.value);
    if (i === times.length - 1) i = 0;
    let time = times[i], last = null;
    const tick = (now) => {
      time += last === null ? 0 : (now - last) / 1000 * speed.value;
      last = now;
      while (i + 1 < times.length && times[i + 1] <= time) i++;
      show(i);
      if (i + 1 < times.length) playing = requestAnimationFrame(tick); else stop();
    };
    button.textContent = "Pause";
    playing = requestAnimationFrame(tick);
  }

  button.addEventListener("click", () => (playing === null ? play() : stop()));
  slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
  slider.addEventListener("keydown", (event) => {
    if (event.key === " ") { event.preventDefault(); button.click(); }
  });
  film.querySelector(".controls").hidden = false;
  show(first);
}
// A table is a stop for the keyboard only while there is something to scroll.
const tables = new ResizeObserver((changes) => {
  for (const { target } of changes) target.tabIndex = target.scrollWidth > target.clientWidth ? 0 : -1;
});
for (const table of document.querySelectorAll(".table")) tables.observe(table);
