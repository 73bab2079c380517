"use strict";
// Camera: orbits around a point or walks on the ground; mouse, touch, keys, buttons; the view in the address.

const EYE = 1.7; // m above the ground, walking

class Camera {
  constructor(scene, canvas, change) {
    Object.assign(this, { scene, change, keys: new Set(), tall: Math.tan((scene.view.fov * Math.PI) / 360) });
    const [eye, target] = [scene.view.eye, scene.view.target].map(([x, y, z]) => [x - scene.corner[0], y - scene.corner[1], z]);
    const way = target.map((value, k) => value - eye[k]);
    const distance = Math.hypot(...way);
    this.first = { mode: "orbit", eye, yaw: Math.atan2(way[0], way[1]), pitch: Math.asin(way[2] / distance), distance };
    this.set(this.first);
    this.listen(canvas);
  }

  set(view) {
    Object.assign(this, view);
    this.change();
  }

  get forward() {
    return [Math.sin(this.yaw) * Math.cos(this.pitch), Math.cos(this.yaw) * Math.cos(this.pitch), Math.sin(this.pitch)];
  }

  // The point so far ahead.
  ahead(distance) {
    return this.eye.map((value, k) => value + distance * this.forward[k]);
  }

  // Keep above the ground; set axes, and the matrix from positions relative to the eye to clip space.
  update(width, height, ground) {
    const floor = Math.max(ground.heightAt(...this.eye), this.scene.sea ?? -Infinity);
    this.eye[2] = this.mode === "walk" ? floor + EYE : Math.max(this.eye[2], floor + 2);
    const [d, e, f] = this.forward;
    this.right = [Math.cos(this.yaw), -Math.sin(this.yaw), 0];
    this.up = [this.right[1] * f, -this.right[0] * f, this.right[0] * e - this.right[1] * d];
    this.wide = (this.tall * width) / height;
    this.pixelsPerRadian = height / (2 * this.tall);
    const [near, far] = [clamp(0.1 * (this.eye[2] - floor), 0.4, 30), 20 * Math.max(...this.scene.size)];
    const rows = [[this.right, 1 / this.wide], [this.up, 1 / this.tall], [this.forward, (far + near) / (far - near)], [this.forward, 1]];
    this.matrix = [0, 1, 2].flatMap((k) => rows.map(([axis, scale]) => axis[k] * scale)).concat(0, 0, (-2 * far * near) / (far - near), 0);
    this.rays = [[this.right, this.wide], [this.up, this.tall], [this.forward, 1]].flatMap(([axis, scale]) => [...axis.map((v) => v * scale), 0]);
  }

  // Whether a sphere, relative to the eye, may be in the picture.
  sees(middle, radius) {
    const along = (axis) => axis[0] * middle[0] + axis[1] * middle[1] + axis[2] * middle[2];
    const depth = along(this.forward);
    const inside = (axis, tangent) => Math.abs(along(axis)) < depth * tangent + radius * Math.hypot(1, tangent);
    return depth > -radius && inside(this.right, this.wide) && inside(this.up, this.tall);
  }

  turn(x, y) {
    const pivot = this.ahead(this.distance);
    this.yaw += x;
    this.pitch = clamp(this.pitch + y, -1.5, this.mode === "walk" ? 1.5 : 0.6);
    if (this.mode === "orbit") this.eye = pivot.map((value, k) => value - this.distance * this.forward[k]);
    this.change();
  }

  move(right, ahead) {
    const [x, y] = [Math.cos(this.yaw) * right + Math.sin(this.yaw) * ahead, Math.cos(this.yaw) * ahead - Math.sin(this.yaw) * right];
    this.eye = [clamp(this.eye[0] + x, 0, this.scene.size[0]), clamp(this.eye[1] + y, 0, this.scene.size[1]), this.eye[2]];
    this.change();
  }

  zoom(factor) {
    const distance = clamp(this.distance * factor, 5, 3 * Math.max(...this.scene.size));
    this.set({ eye: this.ahead(this.distance - distance), distance });
  }

  // Walk where the orbit's centre is; orbit around what is ahead.
  setMode(mode) {
    if (mode === this.mode) return;
    if (mode === "walk") this.set({ mode, eye: this.ahead(this.distance).map((v, k) => (k < 2 ? clamp(v, 0, this.scene.size[k]) : v)), pitch: 0 });
    else this.set({ mode, pitch: -0.3, distance: 300 }), (this.eye = this.ahead(-this.distance));
  }

  get hash() {
    return `#${[this.mode, ...[...this.eye, this.yaw, this.pitch, this.distance].map((value) => +value.toFixed(3))].join(",")}`;
  }

  readHash(hash) {
    const [mode, ...texts] = hash.slice(1).split(",");
    const [x, y, z, yaw, pitch, distance] = texts.map(Number);
    if (["orbit", "walk"].includes(mode) && texts.length === 6 && texts.every((text) => Number.isFinite(Number(text))))
      this.set({ mode, eye: [x, y, z], yaw, pitch, distance });
  }

  // Move by the keys that are held; whether there are any.
  step(seconds) {
    const held = (...names) => Number(names.some((name) => this.keys.has(name)));
    const right = held("KeyD", "ArrowRight") - held("KeyA", "ArrowLeft");
    const ahead = held("KeyW", "ArrowUp") - held("KeyS", "ArrowDown");
    const nearer = held("Equal", "NumpadAdd") - held("Minus", "NumpadSubtract");
    const speed = this.mode === "orbit" ? 0.6 * this.distance : held("ShiftLeft", "ShiftRight") ? 14 : 4;
    if (right || ahead) this.move(right * speed * seconds, ahead * speed * seconds);
    if (nearer) this.zoom(Math.exp(-nearer * seconds));
    return Boolean(right || ahead || nearer);
  }

  listen(canvas) {
    const pointers = new Map();
    const on = (names, action, target = canvas) => names.split(" ").forEach((name) => target.addEventListener(name, action, { passive: false }));
    on("contextmenu", (event) => event.preventDefault());
    on("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
    });
    on("pointerup pointercancel", (event) => pointers.delete(event.pointerId));
    on("pointermove", (event) => {
      const last = pointers.get(event.pointerId);
      if (!last) return;
      const [x, y] = [event.clientX - last.clientX, event.clientY - last.clientY];
      const other = [...pointers.values()].find((each) => each.pointerId !== event.pointerId);
      const metres = (this.mode === "orbit" ? this.distance : 20) / this.pixelsPerRadian;
      if (other || event.buttons & 2 || event.shiftKey) this.move(-x * metres, y * metres);
      else if (this.mode === "orbit") this.turn(0.005 * x, -0.005 * y);
      else this.turn(-0.003 * x, 0.003 * y);
      const spread = ({ clientX, clientY }) => Math.hypot(clientX - other.clientX, clientY - other.clientY);
      if (other && this.mode === "orbit") this.zoom(spread(last) / Math.max(spread(event), 1));
      pointers.set(event.pointerId, event);
    });
    on("wheel", (event) => {
      event.preventDefault();
      if (this.mode === "orbit") this.zoom(Math.exp(0.0012 * event.deltaY));
      else this.move(0, -0.01 * event.deltaY);
    });
    on("keydown", ({ ctrlKey, metaKey, code }) => {
      if (!ctrlKey && !metaKey) this.keys.add(code);
      this.change();
    }, window);
    on("keyup", ({ code }) => this.keys.delete(code), window);
    on("blur", () => this.keys.clear(), window);
  }
}

// Buttons, their keys, and the address.
function controls(camera, element) {
  const actions = {
    orbit: ["KeyO", () => camera.setMode("orbit")],
    walk: ["KeyG", () => camera.setMode("walk")],
    reset: ["KeyR", () => camera.set(camera.first)],
    keys: ["KeyH", () => element("keys").setAttribute("aria-expanded", !(element("help").hidden = !element("help").hidden))],
    share: ["KeyV", async () => {
      history.replaceState(null, "", camera.hash);
      const copied = await navigator.clipboard?.writeText(location.href).then(() => true, () => false);
      element("share").textContent = copied ? "Link copied" : "Link in the address bar";
      setTimeout(() => (element("share").textContent = "Share view"), 2000);
    }],
  };
  for (const [id, [key, action]] of Object.entries(actions)) {
    element(id).addEventListener("click", action);
    addEventListener("keydown", ({ code, ctrlKey, metaKey }) => code === key && !ctrlKey && !metaKey && action());
  }
  addEventListener("hashchange", () => camera.readHash(location.hash));
}
