"use strict";
// Camera: orbit around a point or walk on the ground; mouse, touch, keys; the view in the address.

const EYE = 1.7; // m above the ground, walking

class Camera {
  constructor(scene, canvas, changed) {
    Object.assign(this, { scene, canvas, changed, keys: new Set(), fov: (scene.fov * Math.PI) / 180 });
    const [eye, target] = [scene.eye, scene.target].map(([x, y, z]) => [x - scene.west, y - scene.south, z]);
    const way = target.map((value, k) => value - eye[k]);
    const distance = Math.hypot(...way);
    this.first = { mode: "orbit", eye, yaw: Math.atan2(way[0], way[1]), pitch: Math.asin(way[2] / distance), distance };
    this.moveTo(this.first);
    this.listen();
  }

  moveTo({ mode, eye, yaw, pitch, distance }) {
    Object.assign(this, { mode, eye: [...eye], yaw, pitch, distance });
    this.changed();
  }

  get ahead() {
    const flat = Math.cos(this.pitch);
    return [Math.sin(this.yaw) * flat, Math.cos(this.yaw) * flat, Math.sin(this.pitch)];
  }

  // Directions, the half angles' tangents and the matrix to clip space, relative to the eye.
  update(width, height, ground) {
    const [x, y] = this.eye;
    const floor = Math.max(ground ? ground.heightAt(x, y) : -Infinity, this.mode === "walk" ? -Infinity : this.scene.sea ?? -Infinity);
    if (this.mode === "walk" && ground) this.eye[2] = Math.max(floor, this.scene.sea ?? -Infinity) + EYE;
    else this.eye[2] = Math.max(this.eye[2], floor + 2);
    this.forward = this.ahead;
    this.right = [Math.cos(this.yaw), -Math.sin(this.yaw), 0];
    const [[a, b, c], [d, e, f]] = [this.right, this.forward];
    this.up = [b * f - c * e, c * d - a * f, a * e - b * d];
    const tall = Math.tan(this.fov / 2);
    this.tangents = [(tall * width) / height, tall];
    this.pixelsPerRadian = height / (2 * tall);
    const above = Number.isFinite(floor) ? this.eye[2] - floor : 100;
    const near = Math.min(Math.max(0.1 * above, 0.4), 30);
    const far = 20 * Math.max(...this.scene.size);
    const [p, q, r] = [1 / this.tangents[0], 1 / tall, (far + near) / (far - near)];
    const rows = [this.right.map((v) => v * p), this.up.map((v) => v * q), this.forward.map((v) => v * r), this.forward];
    this.matrix = [0, 1, 2].flatMap((k) => rows.map((row) => row[k])).concat(0, 0, (-2 * far * near) / (far - near), 0);
    this.rays = [...this.right.map((v) => v * this.tangents[0]), ...this.up.map((v) => v * tall), ...this.forward];
  }

  // Whether a sphere, relative to the eye, may be in the picture.
  sees(middle, radius) {
    const along = (axis) => axis[0] * middle[0] + axis[1] * middle[1] + axis[2] * middle[2];
    const depth = along(this.forward);
    const inside = (axis, tangent) => Math.abs(along(axis)) < depth * tangent + radius * Math.hypot(1, tangent);
    return depth > -radius && inside(this.right, this.tangents[0]) && inside(this.up, this.tangents[1]);
  }

  turn(x, y) {
    const pivot = this.eye.map((value, k) => value + this.distance * this.ahead[k]);
    this.yaw += x;
    this.pitch = Math.min(Math.max(this.pitch - y, -1.5), this.mode === "walk" ? 1.5 : 0.6);
    if (this.mode === "orbit") this.eye = pivot.map((value, k) => value - this.distance * this.ahead[k]);
    this.changed();
  }

  pan(right, ahead) {
    const step = [Math.cos(this.yaw) * right + Math.sin(this.yaw) * ahead, Math.cos(this.yaw) * ahead - Math.sin(this.yaw) * right];
    step.forEach((value, k) => {
      const room = this.mode === "walk" ? 0 : this.scene.size[k];
      this.eye[k] = Math.min(Math.max(this.eye[k] + value, -room), this.scene.size[k] + room);
    });
    this.changed();
  }

  zoom(factor) {
    const distance = Math.min(Math.max(this.distance * factor, 5), 4 * Math.max(...this.scene.size));
    this.eye = this.eye.map((value, k) => value + (this.distance - distance) * this.ahead[k]);
    this.distance = distance;
    this.changed();
  }

  setMode(mode) {
    if (mode === "walk") {
      // Down to where the orbit's centre is, if the eye is far above.
      const pivot = this.eye.map((value, k) => value + this.distance * this.ahead[k]);
      if (this.mode === "orbit") this.eye = pivot.map((value, k) => Math.min(Math.max(value, 0), this.scene.size[k] ?? value));
      this.pitch = 0;
    } else if (this.mode === "walk") {
      this.pitch = -0.35;
      this.distance = 400;
      this.eye = this.eye.map((value, k) => value - this.distance * this.ahead[k]);
    }
    this.mode = mode;
    this.changed();
  }

  get hash() {
    const { mode, eye, yaw, pitch, distance } = this;
    return `#${[mode, ...eye.map((v) => v.toFixed(2)), yaw.toFixed(4), pitch.toFixed(4), distance.toFixed(1)].join(",")}`;
  }

  readHash(hash) {
    const [mode, ...numbers] = hash.slice(1).split(",");
    const [x, y, z, yaw, pitch, distance] = numbers.map(Number);
    if (!["orbit", "walk"].includes(mode) || numbers.length !== 6 || !numbers.every((text) => Number.isFinite(Number(text)))) return;
    this.moveTo({ mode, eye: [x, y, z], yaw, pitch, distance });
  }

  // Move by the keys that are held; whether there are any.
  step(seconds) {
    const held = (...names) => names.some((name) => this.keys.has(name));
    const axis = (less, more) => Number(held(...more)) - Number(held(...less));
    const across = axis(["KeyA", "ArrowLeft"], ["KeyD", "ArrowRight"]);
    const ahead = axis(["KeyS", "ArrowDown"], ["KeyW", "ArrowUp"]);
    const nearer = axis(["Minus", "NumpadSubtract"], ["Equal", "NumpadAdd"]);
    if (!across && !ahead && !nearer) return false;
    const speed = this.mode === "walk" ? (held("ShiftLeft", "ShiftRight") ? 14 : 4) : 0.6 * this.distance;
    this.pan(across * speed * seconds, ahead * speed * seconds);
    if (nearer) this.zoom(Math.exp(-nearer * seconds));
    return true;
  }

  listen() {
    const pointers = new Map();
    const { canvas } = this;
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
    });
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => pointers.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const [x, y] = [event.clientX - before.clientX, event.clientY - before.clientY];
      const other = [...pointers.values()].find((each) => each.pointerId !== event.pointerId);
      const metres = this.distance / this.pixelsPerRadian;
      if (other) {
        const spread = (each) => Math.hypot(each.clientX - other.clientX, each.clientY - other.clientY);
        this.pan(-0.5 * x * metres, 0.5 * y * metres);
        if (this.mode === "orbit") this.zoom(spread(before) / Math.max(spread(event), 1));
      } else if (this.mode === "orbit" && (event.buttons & 2 || event.shiftKey)) this.pan(-x * metres, y * metres);
      else if (this.mode === "orbit") this.turn(0.005 * x, 0.005 * -y);
      else this.turn(-0.003 * x, -0.003 * y);
      pointers.set(event.pointerId, event);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (this.mode === "orbit") this.zoom(Math.exp(0.0012 * event.deltaY));
      else this.pan(0, -0.01 * event.deltaY);
    }, { passive: false });
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      this.keys.add(event.code);
      this.changed();
    });
    addEventListener("keyup", (event) => this.keys.delete(event.code));
    addEventListener("blur", () => this.keys.clear());
  }
}
