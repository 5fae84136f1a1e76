"use strict";
for (const svg of document.querySelectorAll("svg[data-turn]")) {
  const [startTurn, startTilt, rise, halfWidth, halfHeight, radius] = svg.dataset.turn.split(" ").map(Number);
  const drawn = [...svg.querySelectorAll("[data-points]")].map((element) => ({
    element, lines: element.dataset.points.split(";").map((line) => line.split(" ").map(Number)),
  }));
  let turn = startTurn, tilt = startTilt, dragged = null;
  const draw = () => {
    const [ct, st, cu, su] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
    const scale = Math.min(halfWidth / radius, halfHeight / (radius * su + rise * cu));
    const at = (x, y, z) => [(ct * x + st * y) * scale, (-cu * z - su * (ct * y - st * x)) * scale].map((v) => v.toFixed(1));
    for (const { element, lines } of drawn) {
      const placed = lines.map((v) => v.flatMap((x, i) => (i % 3 ? [] : [at(x, v[i + 1], v[i + 2]).join(" ")])));
      if (element.tagName === "path") element.setAttribute("d", placed.map((line) => `M${line.join("L")}`).join(""));
      else element.setAttribute("transform", `translate(${placed[0][0]})`);
    }
  };
  const turnBy = (right, up) => {
    turn += right;
    tilt = Math.min(Math.max(tilt + up, 0.03), 1.55);
    draw();
  };
  const reset = () => turnBy(startTurn - turn, startTilt - tilt);
  svg.addEventListener("pointerdown", (event) => {
    dragged = [event.clientX, event.clientY];
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    if (!dragged) return;
    turnBy((event.clientX - dragged[0]) / 150, (event.clientY - dragged[1]) / 150);
    dragged = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => (dragged = null));
  svg.addEventListener("dblclick", reset);
  svg.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1], Home: null }[event.key];
    if (step === undefined) return;
    event.preventDefault();
    step ? turnBy(...step) : reset();
  });
  addEventListener("beforeprint", reset);
  svg.tabIndex = 0;
  svg.classList.add("turns");
}
