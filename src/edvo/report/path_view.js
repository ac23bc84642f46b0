// Draws the path of a run on a canvas that can be turned; reads its data from #path-data.
(function () {
  "use strict";
  const canvas = document.getElementById("path-view");
  const data = JSON.parse(document.getElementById("path-data").textContent);
  const pen = canvas.getContext("2d");
  const COLOURS = ["#c2334a", "#f08c00", "#888888"]; // tracked, degraded, lost
  const VIEWS = {
    "3d": [0.6, 0.45],
    top: [0, Math.PI / 2],
    side: [Math.PI / 2, 0],
    behind: [0, 0],
  };
  const FOCAL = 4; // of the perspective, in radii of the scene

  function bytes(text) {
    return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  }

  const places = new Int16Array(bytes(data.map.places).buffer);
  const colours = bytes(data.map.colours);
  const swatches = [];
  for (let i = 0; i < colours.length; i += 3) {
    swatches.push("rgb(" + colours[i] + "," + colours[i + 1] + "," + colours[i + 2] + ")");
  }

  const view = { yaw: 0, pitch: 0, zoom: 1, right: 0, up: 0 };

  function look(name) {
    [view.yaw, view.pitch] = VIEWS[name];
    view.zoom = 1;
    view.right = view.up = 0;
    draw();
  }

  function shown(name) {
    return document.getElementById("show-" + name).checked;
  }

  // Without the edges there is more room for the path.
  function frame() {
    return shown("map") ? data.scene : data.path;
  }

  // The world has x right, y down, z forward, as the first camera.
  function project(x, y, z) {
    x -= view.centre[0];
    y -= view.centre[1];
    z -= view.centre[2];
    const cosYaw = Math.cos(view.yaw), sinYaw = Math.sin(view.yaw);
    const cosPitch = Math.cos(view.pitch), sinPitch = Math.sin(view.pitch);
    const across = cosYaw * x + sinYaw * z;
    const ahead = cosYaw * z - sinYaw * x;
    const height = sinPitch * ahead - cosPitch * y;
    const depth = cosPitch * ahead + sinPitch * y;
    const distance = FOCAL + depth / view.radius;
    if (distance < 0.2) return null; // behind who looks
    const scale = (view.unit * FOCAL) / distance;
    return [
      view.width / 2 + view.right + scale * across,
      view.height / 2 + view.up - scale * height,
    ];
  }

  function line(points, colour, width) {
    pen.lineWidth = width;
    pen.lineJoin = "round";
    pen.strokeStyle = colour;
    pen.beginPath();
    let begun = false;
    for (const point of points) {
      const at = point && project(point[0], point[1], point[2]);
      if (at && begun) pen.lineTo(at[0], at[1]);
      else if (at) pen.moveTo(at[0], at[1]);
      begun = Boolean(at);
    }
    pen.stroke();
  }

  function drawMap() {
    pen.globalAlpha = 0.8;
    for (let i = 0; i < swatches.length; i += 1) {
      const at = project(
        places[3 * i] * data.map.unit,
        places[3 * i + 1] * data.map.unit,
        places[3 * i + 2] * data.map.unit
      );
      if (at) {
        pen.fillStyle = swatches[i];
        pen.fillRect(at[0] - 0.75, at[1] - 0.75, 1.5, 1.5);
      }
    }
    pen.globalAlpha = 1;
  }

  function drawPath() {
    // One stroke for each stretch of equal status.
    let stretch = [], status = 0;
    for (const point of data.estimate) {
      if (point && stretch.length && point[3] !== status) {
        line(stretch.concat([point]), COLOURS[status], 2);
        stretch = [];
      }
      if (point) status = point[3];
      stretch.push(point);
    }
    line(stretch, COLOURS[status], 2);
  }

  function drawKeyframes() {
    const size = 0.04 * view.radius;
    for (const [place, axes] of data.keyframes) {
      const corner = (u, v) =>
        [0, 1, 2].map(
          (i) => place[i] + size * (0.6 * u * axes[3 * i] + 0.45 * v * axes[3 * i + 1] + axes[3 * i + 2])
        );
      const corners = [corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)];
      line(corners.concat([corners[0]]), "#00798c", 0.8);
      for (const end of corners) line([place, end], "#00798c", 0.8);
    }
  }

  function drawScale() {
    const metres = Math.pow(10, Math.floor(Math.log10((0.3 * view.width) / view.unit)));
    const length = metres * view.unit;
    pen.strokeStyle = pen.fillStyle = "#444";
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(16, view.height - 16);
    pen.lineTo(16 + length, view.height - 16);
    pen.stroke();
    pen.font = "13px system-ui, sans-serif";
    pen.fillText(metres >= 1 ? metres + " m" : Math.round(100 * metres) + " cm", 16, view.height - 22);
  }

  function dot(point, colour) {
    const at = point && project(point[0], point[1], point[2]);
    if (!at) return;
    pen.fillStyle = colour;
    pen.beginPath();
    pen.arc(at[0], at[1], 5, 0, 2 * Math.PI);
    pen.fill();
  }

  function draw() {
    const density = window.devicePixelRatio || 1;
    view.width = canvas.clientWidth;
    view.height = canvas.clientHeight;
    canvas.width = Math.round(view.width * density);
    canvas.height = Math.round(view.height * density);
    ({ centre: view.centre, radius: view.radius } = frame());
    view.unit = (0.45 * view.zoom * Math.min(view.width, view.height)) / view.radius;
    pen.setTransform(density, 0, 0, density, 0, 0);
    pen.clearRect(0, 0, view.width, view.height);
    if (shown("map")) drawMap();
    if (shown("truth")) line(data.truth, "rgba(40,40,40,0.4)", 4);
    if (shown("keyframes")) drawKeyframes();
    drawPath();
    dot(data.estimate[0], COLOURS[0]);
    drawScale();
  }

  let held = null;
  canvas.addEventListener("pointerdown", (event) => {
    held = [event.clientX, event.clientY];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) return;
    const right = event.clientX - held[0], down = event.clientY - held[1];
    held = [event.clientX, event.clientY];
    if (event.shiftKey || event.buttons === 2) {
      view.right += right;
      view.up += down;
    } else {
      view.yaw += 0.008 * right;
      view.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, view.pitch + 0.008 * down));
    }
    draw();
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, () => { held = null; });
  }
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    view.zoom = Math.max(0.1, Math.min(50, view.zoom * Math.exp(-0.0015 * event.deltaY)));
    draw();
  }, { passive: false });
  for (const name of Object.keys(VIEWS)) {
    document.getElementById("view-" + name).addEventListener("click", () => look(name));
  }
  for (const name of ["map", "truth", "keyframes"]) {
    document.getElementById("show-" + name).addEventListener("change", draw);
  }
  window.addEventListener("resize", draw);
  look("3d");
})();
