"use strict";
// The page: loads data scripts, draws with WebGL 2 when something has changed.

const FORMAT = 1; // of the data scripts, as in export/web_data.py
// Textures, each on the unit of its number.
const SAMPLERS = ["sky_view", "noise", "heights", "surface", "cover", "shadows", "weights", "colours", "slopes", "painted", "pictures", "normals"];
const arrived = new Map();

function sketchterrainData(format, name, facts, entries) {
  arrived.set(name, { format, facts, entries });
}

async function unpack([name, kind, size, differences, text]) {
  const deflated = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([deflated]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const Kind = { u1: Uint8Array, i1: Int8Array, u2: Uint16Array, i2: Int16Array, u4: Uint32Array, i4: Int32Array }[kind];
  const values = new Kind(size);
  for (let byte = 0, at = 0; byte < Kind.BYTES_PER_ELEMENT; byte++) for (let k = 0; k < size; k++) values[k] |= bytes[at++] << (8 * byte);
  if (differences) for (let k = 1; k < size; k++) values[k] += values[k - 1];
  return [name, values];
}

// Load a data script and return its facts and arrays.
async function load(name) {
  await new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = `${name}.js`;
    script.onload = resolve;
    script.onerror = () => reject(new Error(`The file ${name}.js is missing: export the page again.`));
    document.head.append(script);
  });
  const data = arrived.get(name);
  if (!data) throw new Error(`The file ${name}.js is incomplete: export the page again.`);
  if (data.format !== FORMAT) throw new Error(`The file ${name}.js has format ${data.format}, expected ${FORMAT}: export the page again.`);
  arrived.delete(name);
  return { facts: data.facts, ...Object.fromEntries(await Promise.all(data.entries.map(unpack))) };
}

class Program {
  constructor(gl, { vertex, fragment }) {
    Object.assign(this, { gl, name: gl.createProgram(), arrays: gl.createVertexArray(), at: {}, uniforms: {} });
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(this.name, shader);
    }
    gl.linkProgram(this.name);
  }

  // Compilation goes on beside the loading of data until this is called.
  finish() {
    const { gl, name } = this;
    if (!gl.getProgramParameter(name, gl.LINK_STATUS)) {
      const logs = gl.getAttachedShaders(name).map((shader) => gl.getShaderInfoLog(shader));
      throw new Error(`A shader does not compile: ${logs.join(" ")} ${gl.getProgramInfoLog(name)}`.trim());
    }
    const block = gl.getUniformBlockIndex(name, "Frame");
    if (block !== gl.INVALID_INDEX) gl.uniformBlockBinding(name, block, 0);
    gl.useProgram(name);
    for (let k = 0; k < gl.getProgramParameter(name, gl.ACTIVE_UNIFORMS); k++) {
      const { name: full, type } = gl.getActiveUniform(name, k);
      const uniform = { type, place: gl.getUniformLocation(name, full) };
      if (!uniform.place) continue;
      if ([gl.SAMPLER_2D, gl.SAMPLER_2D_ARRAY, gl.SAMPLER_2D_SHADOW].includes(type)) {
        gl.uniform1i(uniform.place, SAMPLERS.indexOf(full));
        continue;
      }
      this.uniforms[full.replace("[0]", "")] = uniform;
    }
    for (let k = 0; k < gl.getProgramParameter(name, gl.ACTIVE_ATTRIBUTES); k++) {
      const full = gl.getActiveAttrib(name, k).name;
      this.at[full] = gl.getAttribLocation(name, full);
    }
    return this;
  }

  use() {
    this.gl.useProgram(this.name);
    this.gl.bindVertexArray(this.arrays);
    return this;
  }

  set(values) {
    const { gl } = this;
    for (const [name, value] of Object.entries(values)) {
      const uniform = this.uniforms[name];
      if (!uniform) continue;
      if (uniform.type === gl.FLOAT) gl.uniform1f(uniform.place, value);
      else if (uniform.type === gl.FLOAT_MAT3) gl.uniformMatrix3fv(uniform.place, false, value);
      else gl[`uniform${{ [gl.FLOAT_VEC2]: 2, [gl.FLOAT_VEC3]: 3, [gl.FLOAT_VEC4]: 4 }[uniform.type]}fv`](uniform.place, value);
    }
    return this;
  }

  // Attributes of vertices, [buffer, components, type, normalized, stride, offset] each, and of instances.
  attributes(vertices, instances) {
    const { gl } = this;
    for (const [parts, divisor] of [[vertices.parts, 0], [instances, 1]])
      for (const [name, [buffer, ...layout]] of Object.entries(parts)) {
        const at = this.at[name];
        if (at === undefined) continue;
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.enableVertexAttribArray(at);
        gl.vertexAttribPointer(at, ...layout);
        gl.vertexAttribDivisor(at, divisor);
      }
    if (vertices.index) gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, vertices.index);
    return this;
  }
}

class Page {
  constructor(gl, scene, sky) {
    Object.assign(this, { gl, scene, meshes: {}, textures: {}, stale: true, shadowsAt: null });
    const hardware = gl.getExtension("WEBGL_debug_renderer_info");
    this.software = /SwiftShader|llvmpipe|Software/.test(hardware ? gl.getParameter(hardware.UNMASKED_RENDERER_WEBGL) : "");
    const sources = shaderSources(scene);
    this.programs = Object.fromEntries(Object.entries(sources).map(([name, source]) => [name, new Program(gl, source)]));
    this.textures.sky_view = this.texture(gl.TEXTURE_2D, gl.RGB16F, [64, 128], sky, { filter: gl.LINEAR });
    this.textures.noise = this.texture(gl.TEXTURE_2D, gl.RGBA8, [256, 256], fractalNoise(256), { filter: gl.LINEAR_MIPMAP_LINEAR, wrap: gl.REPEAT });
    for (const name of ["cover", "painted"]) this.textures[name] = this.texture(gl.TEXTURE_2D, gl.RGBA8, [1, 1], new Uint8Array(4), {});
    this.textures.shadows = this.noShadows = this.texture(gl.TEXTURE_2D, gl.DEPTH_COMPONENT24, [1, 1], null, { compare: true });
    this.frame = gl.createBuffer();
    const { corners, triangles } = tileMesh();
    this.tile = this.buffers({ corner: [corners, gl.FLOAT] }, false, triangles);
    this.square = this.buffers({ corner: [new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0]), gl.FLOAT] });
    this.tiles = gl.createBuffer();
  }

  texture(kind, format, [width, height, layers], values, { filter = this.gl.NEAREST, wrap = this.gl.CLAMP_TO_EDGE, compare = false }) {
    const { gl } = this;
    const result = { kind, name: gl.createTexture() };
    const [order, type] = {
      [gl.RGB16F]: [gl.RGB, gl.HALF_FLOAT], [gl.R32F]: [gl.RED, gl.FLOAT], [gl.R8]: [gl.RED, gl.UNSIGNED_BYTE],
      [gl.DEPTH_COMPONENT24]: [gl.DEPTH_COMPONENT, gl.UNSIGNED_INT],
    }[format] ?? [gl.RGBA, gl.UNSIGNED_BYTE];
    gl.bindTexture(kind, result.name);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    if (layers) gl.texImage3D(kind, 0, format, width, height, layers, 0, order, type, values);
    else gl.texImage2D(kind, 0, format, width, height, 0, order, type, values);
    const mipmapped = filter === gl.LINEAR_MIPMAP_LINEAR;
    gl.texParameteri(kind, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(kind, gl.TEXTURE_MAG_FILTER, mipmapped ? gl.LINEAR : filter);
    gl.texParameteri(kind, gl.TEXTURE_WRAP_S, wrap);
    gl.texParameteri(kind, gl.TEXTURE_WRAP_T, wrap);
    if (compare) gl.texParameteri(kind, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    if (mipmapped && values) this.mipmaps(result);
    return result;
  }

  mipmaps({ kind, name }) {
    this.gl.bindTexture(kind, name);
    this.gl.generateMipmap(kind);
    const sharp = this.gl.getExtension("EXT_texture_filter_anisotropic");
    if (sharp && !this.software) this.gl.texParameterf(kind, sharp.TEXTURE_MAX_ANISOTROPY_EXT, 4);
  }

  // Buffers of attributes of three components; `planes`: a component after the other.
  buffers(attributes, planes = false, triangles = null) {
    const { gl } = this;
    const result = { parts: {}, arrays: {} };
    for (const [name, [values, type, components = 3]] of Object.entries(attributes)) {
      result.arrays[name === "tint" ? "colour" : name] = values;
      let ordered = values;
      if (planes) {
        ordered = new values.constructor(values.length);
        const count = values.length / components;
        for (let axis = 0; axis < components; axis++) for (let k = 0; k < count; k++) ordered[components * k + axis] = values[axis * count + k];
      }
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, ordered, gl.STATIC_DRAW);
      result.parts[name] = [buffer, components, type, type !== gl.FLOAT, 0, 0];
    }
    if (triangles) {
      result.index = gl.createBuffer();
      gl.bindVertexArray(null);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, result.index);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
      result.count = triangles.length;
    }
    return result;
  }

  setGround(ground) {
    const { gl, textures } = this;
    const size = [ground.columns, ground.rows];
    const replace = (name, ...rest) => {
      if (textures[name]) gl.deleteTexture(textures[name].name);
      textures[name] = this.texture(gl.TEXTURE_2D, ...rest);
    };
    this.ground = ground;
    replace("heights", gl.R32F, size, ground.height, { filter: gl.getExtension("OES_texture_float_linear") ? gl.LINEAR : gl.NEAREST });
    replace("surface", gl.RGBA8, size, ground.surface(this.scene.toSun), { filter: gl.LINEAR_MIPMAP_LINEAR });
    this.plants?.settle(ground);
    this.change();
  }

  setWeights(planes, columns, rows) {
    const { gl } = this;
    const layers = Math.ceil(this.scene.materials.length / 4);
    const texels = new Uint8Array(4 * columns * rows * layers);
    const count = columns * rows;
    for (let k = 0; k < this.scene.materials.length; k++)
      for (let i = 0, at = (k >> 2) * 4 * count + (k & 3), from = k * count; i < count; i++, at += 4) texels[at] = 17 * planes[from + i];
    if (this.textures.weights) gl.deleteTexture(this.textures.weights.name);
    this.textures.weights = this.texture(gl.TEXTURE_2D_ARRAY, gl.RGBA8, [columns, rows, layers], texels, { filter: gl.LINEAR });
    this.change();
  }

  async setTextures(webp) {
    const { gl, scene } = this;
    const picture = await createImageBitmap(new Blob([webp], { type: "image/webp" }), { colorSpaceConversion: "none" });
    const side = picture.width / 2;
    const canvas = Object.assign(document.createElement("canvas"), { width: picture.width, height: picture.height });
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(picture, 0, 0);
    const { data } = context.getImageData(0, 0, picture.width, picture.height);
    const layers = scene.materials.length;
    const colours = new Uint8Array(4 * side * side * layers);
    const slopes = new Uint8Array(colours.length);
    for (let row = 0, at = 0; row < side * layers; row++) {
      const { bump } = scene.materials[Math.floor(row / side)];
      const top = Math.floor(row / side) * side;
      const height = (i, j) => data[4 * ((top + ((j + side) % side)) * 2 * side + side + ((i + side) % side))];
      for (let column = 0, j = row - top; column < side; column++, at += 4) {
        const from = 4 * (row * 2 * side + column);
        colours.set([data[from], data[from + 1], data[from + 2], height(column, j)], at);
        const scale = (0.5 * 127.5 * 0.5 * bump * side) / 255; // slopes are halved
        slopes[at] = Math.min(Math.max(127.5 + scale * (height(column + 1, j) - height(column - 1, j)), 0), 255);
        slopes[at + 1] = Math.min(Math.max(127.5 + scale * (height(column, j + 1) - height(column, j - 1)), 0), 255);
      }
    }
    const settings = { filter: gl.LINEAR_MIPMAP_LINEAR, wrap: gl.REPEAT };
    this.textures.colours = this.texture(gl.TEXTURE_2D_ARRAY, gl.SRGB8_ALPHA8, [side, side, layers], colours, settings);
    this.textures.slopes = this.texture(gl.TEXTURE_2D_ARRAY, gl.RGBA8, [side, side, layers], slopes, settings);
  }

  // Positions in metres of a mesh in centimetres.
  static places({ x, y, z }) {
    const result = new Float32Array(3 * x.length);
    [x, y, z].forEach((values, axis) => values.forEach((value, k) => (result[3 * k + axis] = value / 100)));
    return result;
  }

  setSurroundings({ height, colour }) {
    const { gl, scene } = this;
    const { rings, around, growth, low, metres } = scene.surroundings;
    const half = scene.size.map((value) => value / 2);
    const place = new Float32Array(3 * rings * around);
    const triangles = [];
    const corner = (turn) => Math.min(Math.max(Math.abs(((turn + 1) % 8) - 4) - 2, -1), 1);
    for (let ring = 0, k = 0; ring < rings; ring++)
      for (let i = 0; i < around; i++, k++) {
        const turn = (8 * i) / around;
        const x = corner(turn + 6);
        const y = corner(turn + 4);
        place.set([half[0] * (1 + growth[ring] * x), half[1] * (1 + growth[ring] * y), low + metres * height[k]], 3 * k);
        const next = ring * around + ((i + 1) % around);
        if (ring + 1 < rings) triangles.push(k, k + around, next + around, k, next + around, next);
      }
    const index = new Uint32Array(triangles);
    const normal = vertexNormals(place, index);
    const tint = new Uint8Array(colour.length);
    for (let k = 0; k < colour.length / 3; k++) for (let axis = 0; axis < 3; axis++) tint[3 * k + axis] = colour[(axis * colour.length) / 3 + k];
    this.meshes.surroundings = this.buffers({ place: [place, gl.FLOAT], normal: [normal, gl.FLOAT], tint: [tint, gl.UNSIGNED_BYTE] }, false, index);
    this.change();
  }

  change() {
    this.stale = true;
    this.wake?.();
  }

  drawMesh(mesh, program, values) {
    if (!mesh) return;
    program.use().set(values).attributes(mesh, {});
    this.gl.drawElements(this.gl.TRIANGLES, mesh.count, this.gl.UNSIGNED_INT, 0);
  }

  bind(textures) {
    for (const [name, texture] of Object.entries(textures)) {
      this.gl.activeTexture(this.gl.TEXTURE0 + SAMPLERS.indexOf(name));
      this.gl.bindTexture(texture.kind, texture.name);
    }
  }

  updateFrame(camera, width, height) {
    const { scene } = this;
    const values = new Float32Array(192);
    values.set(camera.matrix, 0);
    values.set(camera.eye, 32);
    values.set(scene.toSun, 36);
    values.set([...scene.sunlight, 0], 40);
    scene.harmonics.forEach((row, k) => values.set(row, 44 + 4 * k));
    values.set(scene.haze, 80);
    values.set(scene.air, 84);
    values.set([3.4 * Math.max(...scene.size), 0, width, height], 88);
    values.set([this.clock, 0, 0, 0, ...this.ground.cell, ...scene.size], 92); // shaders.js
    values.set(this.shadowMatrix(camera), 120);
    values.set([0, 0, 1 / camera.pixelsPerRadian, 0], 188);
    this.gl.bindBuffer(this.gl.UNIFORM_BUFFER, this.frame);
    this.gl.bufferData(this.gl.UNIFORM_BUFFER, values, this.gl.STREAM_DRAW);
    this.gl.bindBufferBase(this.gl.UNIFORM_BUFFER, 0, this.frame);
  }

  // From positions relative to the eye to the map of shadows, which lies around `shadowsAt`.
  shadowMatrix({ eye }) {
    const { toSun, size } = this.scene;
    if (!this.shadowsAt) return new Float32Array(16).fill(0).with?.(15, 1) ?? new Float32Array(16);
    const { middle, radius } = this.shadowsAt;
    const right = [toSun[1], -toSun[0], 0].map((value) => value / Math.hypot(toSun[0], toSun[1], 1e-9));
    const up = [-right[1] * toSun[2], right[0] * toSun[2], right[1] * toSun[0] - right[0] * toSun[1]].map((v) => -v);
    const deep = Math.max(4 * radius, 800);
    const rows = [right.map((v) => v / radius), up.map((v) => v / radius), toSun.map((v) => -v / deep)];
    const offset = eye.map((value, k) => value - middle[k]);
    const moved = rows.map((row) => row.reduce((sum, value, k) => sum + value * offset[k], 0));
    return [0, 1, 2].flatMap((k) => [...rows.map((row) => row[k]), 0]).concat(moved, 1);
  }

  draw(camera, clock) {
    const { gl, scene, programs, textures, meshes, ground } = this;
    const { width, height } = gl.canvas;
    camera.update(width, height, ground);
    this.clock = clock;
    gl.enable(gl.DEPTH_TEST);
    if (this.plants) {
      const above = camera.eye[2] - ground.heightAt(...camera.eye);
      const radius = Math.min(Math.max(2.5 * above, 160), 1200);
      const at = this.shadowsAt;
      const centre = camera.eye.map((value, k) => value + 0.55 * radius * camera.forward[k]);
      centre[2] = ground.heightAt(...centre);
      if (!at || Math.hypot(...centre.map((v, k) => v - at.middle[k])) > 0.2 * at.radius || Math.abs(Math.log(radius / at.radius)) > 0.3) {
        this.shadowsAt = { middle: centre, radius };
        this.bind({ ...textures, shadows: this.noShadows });
        this.updateFrame(camera, width, height);
        this.plants.drawShadows({ eye: centre }, radius);
        textures.shadows = this.plants.shadow;
      }
    }
    this.updateFrame(camera, width, height);
    this.bind(textures);
    gl.viewport(0, 0, width, height);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.disable(gl.BLEND);
    gl.depthMask(true);
    gl.enable(gl.CULL_FACE);
    const tiles = ground.visibleTiles(camera, 1.5);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.tiles);
    gl.bufferData(gl.ARRAY_BUFFER, tiles, gl.STREAM_DRAW);
    programs.ground.use().attributes(this.tile, { tile: [this.tiles, 3, gl.FLOAT, false, 0, 0] });
    gl.drawElementsInstanced(gl.TRIANGLES, this.tile.count, gl.UNSIGNED_SHORT, 0, tiles.length / 3);
    gl.disable(gl.CULL_FACE);
    this.drawMesh(meshes.surroundings, programs.surroundings, {});
    this.drawMesh(meshes.built, programs.built, {});
    this.plants?.draw(camera);
    gl.depthFunc(gl.LEQUAL);
    programs.sky.use().set({ rays: camera.rays });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.depthFunc(gl.LESS);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ZERO, gl.ONE);
    gl.depthMask(false);
    this.drawMesh(meshes.water, programs.water, {});
    gl.depthMask(true);
    return tiles.length / 3;
  }
}

// Four channels of smooth noise that repeats, octaves from a quarter of the side on.
function fractalNoise(side) {
  const sum = new Float32Array(4 * side * side);
  let seed = 1;
  for (let cells = 4, share = 0.5; cells <= side / 2; cells *= 2, share *= 0.55) {
    const lattice = Float32Array.from({ length: 4 * cells * cells }, () => (seed = (seed * 48271) % 2147483647) / 2147483647 - 0.5);
    for (let row = 0, at = 0; row < side; row++)
      for (let column = 0; column < side; column++) {
        const [x, y] = [(column * cells) / side, (row * cells) / side];
        const [i, j, u, v] = [x | 0, y | 0, ...[x % 1, y % 1].map((t) => t * t * (3 - 2 * t))];
        const corner = (a, b) => 4 * (((j + b) % cells) * cells + ((i + a) % cells));
        const [p, q, r, s] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        for (let k = 0; k < 4; k++, at++)
          sum[at] += share * ((lattice[p + k] * (1 - u) + lattice[q + k] * u) * (1 - v) + (lattice[r + k] * (1 - u) + lattice[s + k] * u) * v);
      }
  }
  return new Uint8Array(Uint8ClampedArray.from(sum, (value) => 127.5 + 255 * value).buffer);
}

function vertexNormals(place, index) {
  const normal = new Float32Array(place.length);
  for (let k = 0; k < index.length; k += 3) {
    const [a, b, c] = [3 * index[k], 3 * index[k + 1], 3 * index[k + 2]];
    const [u, v] = [b, c].map((to) => [0, 1, 2].map((axis) => place[to + axis] - place[a + axis]));
    const cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (const at of [a, b, c]) for (let axis = 0; axis < 3; axis++) normal[at + axis] += cross[axis];
  }
  return normal;
}

async function show() {
  const started = performance.now();
  const element = (id) => document.getElementById(id);
  const canvas = element("view");
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "high-performance" });
  if (!gl) throw new Error("This browser has no WebGL 2, which the page needs.");
  const { facts: scene, sky } = await load("scene");
  document.title = element("title").textContent = scene.title;
  const coming = Object.fromEntries(scene.files.map((name) => [name, load(name)]));
  for (const promise of Object.values(coming)) promise.catch(() => {});
  const page = new Page(gl, scene, sky);
  const camera = new Camera(scene, canvas, () => page.change());
  camera.readHash(location.hash);

  const stats = window.sketchterrain.stats;
  Object.assign(stats, { frames: 0, plants: 0, tiles: 0, frame: 0 });
  Object.assign(window.sketchterrain, { camera, page });
  let scheduled = false;
  let before = 0;
  const paint = (now) => {
    scheduled = false;
    if (!page.ground || document.hidden) return;
    const ratio = Math.min(devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(Math.round(side * ratio), 1));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    page.stale = false;
    const moving = camera.step(Math.min((now - before) / 1000, 0.1));
    const start = performance.now();
    stats.tiles = page.draw(camera, start / 1000);
    if (window.sketchterrain.timed) gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    stats.frame = performance.now() - start;
    stats.frames++;
    stats.plants = page.plants?.drawn ?? 0;
    before = now;
    element("orbit").setAttribute("aria-pressed", camera.mode === "orbit");
    element("walk").setAttribute("aria-pressed", camera.mode === "walk");
    if (moving) page.wake();
  };
  page.wake = () => {
    if (!scheduled) requestAnimationFrame(paint);
    scheduled = true;
  };
  new ResizeObserver(() => page.change()).observe(canvas);
  document.addEventListener("visibilitychange", () => page.change());
  addEventListener("hashchange", () => camera.readHash(location.hash));
  const actions = {
    orbit: () => camera.setMode("orbit"),
    walk: () => camera.setMode("walk"),
    reset: () => camera.moveTo(camera.first),
    keys: () => element("keys").setAttribute("aria-expanded", !(element("help").hidden = !element("help").hidden)),
    share: async () => {
      history.replaceState(null, "", camera.hash);
      await navigator.clipboard?.writeText(location.href).catch(() => {});
      element("share").textContent = "Link copied";
      setTimeout(() => (element("share").textContent = "Share view"), 1500);
    },
  };
  for (const [id, action] of Object.entries(actions)) element(id).addEventListener("click", action);
  const shortcuts = { KeyO: "orbit", KeyG: "walk", KeyR: "reset", KeyH: "keys" };
  addEventListener("keydown", (event) => {
    if (!event.ctrlKey && !event.metaKey && shortcuts[event.code]) actions[shortcuts[event.code]]();
  });

  let level = { columns: Math.ceil((scene.columns - 1) / scene.step) + 1, rows: Math.ceil((scene.rows - 1) / scene.step) + 1 };
  const coarse = await coming.coarse;
  level.numbers = coarse.heights;
  page.setWeights(coarse.weights, level.columns, level.rows);
  await page.setTextures((await coming.textures).webp);
  for (const program of Object.values(page.programs)) program.finish();
  const sizes = scene.materials.flatMap(({ width, octaves, roughness }) => [width, octaves[1], roughness, 0]);
  page.programs.ground.use().set({ sizes });
  if (scene.colours.length) page.programs.built.use().set({ palette: scene.colours.flat() });
  page.setGround(new Ground(scene, level, scene.step));
  stats.first = performance.now() - started;

  page.setSurroundings(await coming.surroundings);
  if (coming.water) {
    const data = await coming.water;
    page.meshes.water = page.buffers({ place: [Page.places(data), gl.FLOAT] }, false, data.triangles);
  }
  if (coming.built) {
    const data = await coming.built;
    const mesh = page.buffers({ place: [Page.places(data), gl.FLOAT] }, false, data.triangles);
    const [buffer] = Object.values(page.buffers({ material: [data.material, gl.UNSIGNED_BYTE, 1] }).parts.material);
    mesh.parts.material = [buffer, 1, gl.UNSIGNED_BYTE, false, 0, 0];
    page.meshes.built = mesh;
  }
  if (coming.foliage) {
    page.plants = new Plants(page, await coming.models, await coming.foliage);
    page.textures.cover = page.texture(gl.TEXTURE_2D, gl.R8, [512, 512], page.plants.cover(), { filter: gl.LINEAR });
    page.plants.settle(page.ground);
  }
  for (let number = 1, step = scene.step / 2; number <= scene.levels; number++, step /= 2) {
    level = finerLevel(level, (await coming[`heights${number}`]).rest);
    page.setGround(new Ground(scene, level, step));
    await new Promise((resolve) => setTimeout(resolve));
  }
  const { weights, painted } = await coming.weights;
  page.setWeights(weights, level.columns, level.rows);
  if (painted) {
    const texels = new Uint8Array(painted.length);
    for (let axis = 0; axis < 4; axis++) for (let k = 0; k < texels.length / 4; k++) texels[4 * k + axis] = painted[(axis * texels.length) / 4 + k];
    page.textures.painted = page.texture(gl.TEXTURE_2D, gl.RGBA8, [level.columns, level.rows], texels, { filter: gl.LINEAR });
  }
  page.shadowsAt = null;
  page.change();
  await new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)));
  element("message").hidden = true;
  stats.complete = performance.now() - started;
  // Waves and clouds move a few times a second.
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const animate = () => {
    if (!document.hidden && !still.matches && page.meshes.water) page.change();
    setTimeout(animate, Math.max(80, 4 * stats.frame));
  };
  animate();
}

window.sketchterrain = { stats: {} };
window.sketchterrain.ready = show();
window.sketchterrain.ready.catch((error) => {
  const message = document.getElementById("message");
  message.hidden = false;
  message.textContent = error.message;
});
