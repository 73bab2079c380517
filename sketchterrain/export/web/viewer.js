"use strict";
// The page: loads data scripts, and draws with WebGL 2 when something has changed.

const FORMAT = 1; // of the data scripts, as in export/targets/web.py
const SAMPLERS = ["sky_view", "noise", "heights", "surface", "cover", "shadows", "weights", "colours", "slopes", "painted", "pictures", "normals"];
const PIXELS = 1.5; // error of the ground's tiles
const arrived = new Map();

function sketchterrainData(format, name, facts, entries) {
  arrived.set(name, { format, facts, entries });
}

async function unpack([name, kind, size, differences, text]) {
  const { body } = await fetch(`data:;base64,${text}`); // faster than atob
  const bytes = new Uint8Array(await new Response(body.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
  const Kind = { u1: Uint8Array, i1: Int8Array, u2: Uint16Array, i2: Int16Array, u4: Uint32Array, i4: Int32Array }[kind];
  const values = new Kind(size);
  for (let at = 0, plane = 0; at < bytes.length; plane += 8) for (let k = 0; k < size; k++) values[k] |= bytes[at++] << plane;
  if (differences) for (let k = 1; k < size; k++) values[k] += values[k - 1];
  return [name, values];
}

// The facts and arrays of a data script; index.html reports missing files.
async function load(name) {
  await new Promise((onload, onerror) => document.head.append(Object.assign(document.createElement("script"), { src: `${name}.js`, onload, onerror })));
  const { format, facts, entries } = arrived.get(name) ?? {};
  if (format !== undefined && format !== FORMAT) throw new Error(`The file ${name}.js has format ${format}, expected ${FORMAT}: export the page again.`);
  const arrays = await Promise.all((entries ?? [null]).map(unpack)).catch(() => {
    throw new Error(`The file ${name}.js is incomplete: export the page again.`);
  });
  return { facts, ...Object.fromEntries(arrays) };
}

// Values of an array in planes, side by side.
function interleaved(planes, parts) {
  const count = planes.length / parts;
  return planes.map((_, k) => planes[(k % parts) * count + Math.floor(k / parts)]);
}

class Program {
  constructor(gl, { vertex, fragment }) {
    Object.assign(this, { gl, name: gl.createProgram(), arrays: gl.createVertexArray() });
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(this.name, shader);
    }
    gl.linkProgram(this.name);
  }

  // Until this is called, browsers compile beside the loading of data.
  finish() {
    const { gl, name } = this;
    const logs = () => gl.getAttachedShaders(name).map((shader) => gl.getShaderInfoLog(shader)).join(" ");
    if (!gl.getProgramParameter(name, gl.LINK_STATUS)) throw new Error(`A shader fails: ${logs()} ${gl.getProgramInfoLog(name)}`);
    const block = gl.getUniformBlockIndex(name, "Frame");
    if (block !== gl.INVALID_INDEX) gl.uniformBlockBinding(name, block, 0);
    gl.useProgram(name);
    SAMPLERS.forEach((sampler, unit) => gl.uniform1i(this.uniform(sampler), unit));
  }

  uniform(name) {
    return this.gl.getUniformLocation(this.name, name);
  }

  // Use it with the attributes of a mesh and of instances: [buffer, components, type, normalized, stride, offset] each.
  use(mesh, instances = {}) {
    const { gl, name } = this;
    gl.useProgram(name);
    gl.bindVertexArray(this.arrays);
    for (const [parts, divisor] of [[mesh?.parts ?? {}, 0], [instances, 1]])
      for (const [attribute, [buffer, ...layout]] of Object.entries(parts)) {
        const at = gl.getAttribLocation(name, attribute);
        if (at < 0) continue;
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.enableVertexAttribArray(at);
        gl.vertexAttribPointer(at, ...layout);
        gl.vertexAttribDivisor(at, divisor);
      }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh?.index ?? null);
  }
}

class Page {
  constructor(gl, scene, sky) {
    const hardware = gl.getExtension("WEBGL_debug_renderer_info");
    const software = /SwiftShader|llvmpipe|Basic Render/.test(hardware && gl.getParameter(hardware.UNMASKED_RENDERER_WEBGL));
    Object.assign(this, { gl, scene, software, meshes: {}, textures: {}, shadowsAt: null, frame: gl.createBuffer(), tiles: gl.createBuffer() });
    this.smoothHeights = gl.getExtension("OES_texture_float_linear") ? gl.LINEAR : gl.NEAREST;
    this.programs = Object.fromEntries(Object.entries(shaderSources(scene, software)).map(([name, source]) => [name, new Program(gl, source)]));
    this.textures.sky_view = this.texture(gl.TEXTURE_2D, gl.RGB16F, [64, 128], sky, { filter: gl.LINEAR });
    this.textures.noise = this.texture(gl.TEXTURE_2D, gl.RGBA8, [128, 128], smoothNoise(128), { filter: gl.LINEAR_MIPMAP_LINEAR, wrap: gl.REPEAT });
    for (const name of ["cover", "painted"]) this.textures[name] = this.texture(gl.TEXTURE_2D, gl.RGBA8, [1, 1], new Uint8Array(4), {});
    this.textures.shadows = this.noShadows = this.texture(gl.TEXTURE_2D, gl.DEPTH_COMPONENT24, [1, 1], null, { compare: true });
    const [corners, triangles] = tileMesh();
    this.tile = this.mesh({ corner: corners }, triangles);
    this.square = this.mesh({ corner: new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0]), tint: new Float32Array(12).fill(1) });
  }

  texture(kind, format, [width, height, layers], values, { filter = this.gl.NEAREST, wrap = this.gl.CLAMP_TO_EDGE, compare = false }) {
    const { gl } = this;
    const result = { kind, name: gl.createTexture() };
    const layouts = { [gl.RGB16F]: [gl.RGB, gl.HALF_FLOAT], [gl.R32F]: [gl.RED, gl.FLOAT], [gl.R8]: [gl.RED, gl.UNSIGNED_BYTE], [gl.DEPTH_COMPONENT24]: [gl.DEPTH_COMPONENT, gl.UNSIGNED_INT] };
    const layout = layouts[format] ?? [gl.RGBA, gl.UNSIGNED_BYTE];
    gl.bindTexture(kind, result.name);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    if (layers) gl.texImage3D(kind, 0, format, width, height, layers, 0, ...layout, values);
    else gl.texImage2D(kind, 0, format, width, height, 0, ...layout, values);
    const mipmapped = filter === gl.LINEAR_MIPMAP_LINEAR;
    const settings = { MIN_FILTER: compare ? gl.LINEAR : filter, MAG_FILTER: mipmapped || compare ? gl.LINEAR : filter, WRAP_S: wrap, WRAP_T: wrap };
    for (const [name, value] of Object.entries(settings)) gl.texParameteri(kind, gl[`TEXTURE_${name}`], value);
    if (compare) gl.texParameteri(kind, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    if (mipmapped && values) this.mipmaps(result);
    return result;
  }

  mipmaps({ kind, name }) {
    const sharp = !this.software && this.gl.getExtension("EXT_texture_filter_anisotropic");
    this.gl.bindTexture(kind, name);
    this.gl.generateMipmap(kind);
    if (sharp) this.gl.texParameterf(kind, sharp.TEXTURE_MAX_ANISOTROPY_EXT, 4);
  }

  framebuffer(attachments) {
    const { gl } = this;
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    for (const [point, { name }] of attachments) gl.framebufferTexture2D(gl.FRAMEBUFFER, point, gl.TEXTURE_2D, name, 0);
    return frame;
  }

  buffer(kind, values) {
    const { gl } = this;
    const buffer = gl.createBuffer();
    gl.bindVertexArray(null);
    gl.bindBuffer(kind, buffer);
    gl.bufferData(kind, values, gl.STATIC_DRAW);
    return buffer;
  }

  // Attributes of three components, integers as shares; in planes if their components follow each other.
  mesh(attributes, triangles = null, planes = false) {
    const { gl } = this;
    const types = new Map([[Float32Array, gl.FLOAT], [Uint8Array, gl.UNSIGNED_BYTE], [Int8Array, gl.BYTE], [Int16Array, gl.SHORT]]);
    const parts = Object.entries(attributes).map(([name, values]) => {
      const type = types.get(values.constructor);
      return [name, [this.buffer(gl.ARRAY_BUFFER, planes ? interleaved(values, 3) : values), 3, type, type !== gl.FLOAT, 0, 0]];
    });
    return { parts: Object.fromEntries(parts), index: triangles && this.buffer(gl.ELEMENT_ARRAY_BUFFER, triangles), count: triangles?.length };
  }

  // A mesh of the data scripts, whose places are in centimetres, with smooth normals.
  dataMesh({ x, y, z, triangles, tint }) {
    const place = Float32Array.from({ length: 3 * x.length }, (_, k) => [x, y, z][k % 3][Math.floor(k / 3)] / 100);
    const normal = new Float32Array(place.length);
    for (let k = 0; k < triangles.length; k += 3) {
      const [a, b, c] = [3 * triangles[k], 3 * triangles[k + 1], 3 * triangles[k + 2]];
      const [ux, uy, uz, vx, vy, vz] = [b, c].flatMap((to) => [0, 1, 2].map((axis) => place[to + axis] - place[a + axis]));
      const cross = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
      for (const at of [a, b, c]) for (let axis = 0; axis < 3; axis++) normal[at + axis] += cross[axis];
    }
    return this.mesh(tint ? { place, normal, tint: interleaved(tint, 3) } : { place }, triangles);
  }

  setTexture(name, ...rest) {
    if (this.textures[name]) this.gl.deleteTexture(this.textures[name].name);
    this.textures[name] = this.texture(...rest);
  }

  setGround(ground) {
    const { gl } = this;
    const size = [ground.columns, ground.rows];
    this.ground = ground;
    this.setTexture("heights", gl.TEXTURE_2D, gl.R32F, size, ground.height, { filter: this.smoothHeights });
    this.setTexture("surface", gl.TEXTURE_2D, gl.RGBA8, size, ground.surface(this.scene.toSun), { filter: gl.LINEAR_MIPMAP_LINEAR });
    this.plants?.settle(ground);
    this.shadowsAt = null;
  }

  setWeights(planes, { columns, rows }) {
    const { gl } = this;
    const [count, materials] = [columns * rows, this.scene.materials.length];
    const layers = Math.ceil(materials / 4);
    const texels = new Uint8Array(4 * count * layers);
    for (let k = 0; k < materials; k++)
      for (let i = 0, at = (k >> 2) * 4 * count + (k & 3); i < count; i++, at += 4) texels[at] = 17 * planes[k * count + i];
    this.setTexture("weights", gl.TEXTURE_2D_ARRAY, gl.RGBA8, [columns, rows, layers], texels, { filter: gl.LINEAR });
  }

  // Colours of the materials, and slopes of their heights, from one picture.
  async setColours(webp) {
    const { gl, scene } = this;
    const picture = await createImageBitmap(new Blob([webp], { type: "image/webp" }), { colorSpaceConversion: "none" });
    const [width, side, layers] = [picture.width, picture.width / 2, scene.materials.length];
    const context = Object.assign(document.createElement("canvas"), { width, height: picture.height }).getContext("2d");
    context.drawImage(picture, 0, 0);
    const { data } = context.getImageData(0, 0, width, picture.height);
    const colours = new Uint8Array(4 * side * side * layers);
    const slopes = new Uint8Array(colours.length);
    for (let k = 0; k < side * side * layers; k++) {
      const [column, row, layer] = [k % side, Math.floor(k / side) % side, Math.floor(k / side / side)];
      const at = (i, j) => 4 * ((layer * side + ((row + j + side) % side)) * width + ((column + i + side) % side));
      const height = (i, j) => data[at(i, j) + 4 * side];
      const scale = (63.75 * 0.5 * scene.materials[layer].bump * side) / 255;
      colours.set([data[at(0, 0)], data[at(0, 0) + 1], data[at(0, 0) + 2], height(0, 0)], 4 * k);
      slopes[4 * k] = clamp(127.5 + scale * (height(1, 0) - height(-1, 0)), 0, 255);
      slopes[4 * k + 1] = clamp(127.5 + scale * (height(0, 1) - height(0, -1)), 0, 255);
    }
    const settings = { filter: gl.LINEAR_MIPMAP_LINEAR, wrap: gl.REPEAT };
    this.setTexture("colours", gl.TEXTURE_2D_ARRAY, gl.SRGB8_ALPHA8, [side, side, layers], colours, settings);
    this.setTexture("slopes", gl.TEXTURE_2D_ARRAY, gl.RGBA8, [side, side, layers], slopes, settings);
  }

  // What kernels/render/frame.glsl declares; shaders.js says what its maps carry.
  updateFrame(camera) {
    const { gl, scene, scene: { view } } = this;
    const { width, height } = gl.canvas;
    const values = new Float32Array(192);
    const parts = {
      0: camera.matrix, 16: camera.rays, 32: camera.eye, 36: scene.toSun, 40: view.sunlight, 44: view.harmonics.flatMap((row) => [...row, 0]),
      80: view.haze, 83: [view.haze_height], 84: view.air, 87: [view.air_height], 88: [3.4 * Math.max(...scene.size), 0, width, height], 92: [this.clock], 96: [...this.ground.cell, ...scene.size],
      120: this.shadowMatrix(camera.eye), 190: [1 / camera.pixelsPerRadian],
    };
    for (const [at, part] of Object.entries(parts)) values.set(part, at);
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.frame);
    gl.bufferData(gl.UNIFORM_BUFFER, values, gl.STREAM_DRAW);
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, this.frame);
  }

  // From positions relative to the eye to the map of shadows.
  shadowMatrix(eye) {
    if (!this.shadowsAt) return [...new Array(12).fill(0), 9, 9, 9, 1];
    const { middle, radius } = this.shadowsAt;
    const [x, y, z] = this.scene.toSun;
    const flat = Math.hypot(x, y);
    const rows = [[y / flat / radius, -x / flat / radius, 0], [(-x * z) / flat / radius, (-y * z) / flat / radius, flat / radius], [x, y, z].map((v) => v / -(4 * radius + 400))];
    const moved = rows.map((row) => row.reduce((sum, value, k) => sum + value * (eye[k] - middle[k]), 0));
    return [...[0, 1, 2].flatMap((k) => [...rows.map((row) => row[k]), 0]), ...moved, 1];
  }

  // Shadows of plants around what is seen; drawn when the eye has moved far enough.
  updateShadows(camera) {
    const radius = clamp(5 * (camera.eye[2] - this.ground.heightAt(...camera.eye)), 140, 1600);
    const middle = camera.eye.map((value, k) => value + 0.6 * radius * camera.forward[k]);
    middle[2] = this.ground.heightAt(...middle);
    const at = this.shadowsAt;
    if (at && Math.hypot(...middle.map((v, k) => v - at.middle[k])) < 0.2 * radius && Math.abs(Math.log(radius / at.radius)) < 0.3) return;
    this.shadowsAt = { middle, radius };
    this.updateFrame(camera);
    this.bind({ ...this.textures, shadows: this.noShadows });
    this.plants.drawShadows(middle, radius);
    this.textures.shadows = this.plants.shadow;
  }

  bind(textures) {
    for (const [name, texture] of Object.entries(textures)) {
      this.gl.activeTexture(this.gl.TEXTURE0 + SAMPLERS.indexOf(name));
      this.gl.bindTexture(texture.kind, texture.name);
    }
  }

  draw(camera) {
    const { gl, programs, meshes } = this;
    const drawMesh = (mesh, program) => {
      if (!mesh) return;
      program.use(mesh);
      gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
    };
    this.clock = performance.now() / 1000;
    camera.update(gl.canvas.width, gl.canvas.height, this.ground);
    gl.enable(gl.DEPTH_TEST);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
    if (this.plants) this.updateShadows(camera);
    this.updateFrame(camera);
    this.bind(this.textures);
    gl.viewport(0, 0, gl.canvas.width, gl.canvas.height);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const tiles = this.ground.visibleTiles(camera, this.software ? 3 * PIXELS : PIXELS);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.tiles);
    gl.bufferData(gl.ARRAY_BUFFER, tiles, gl.STREAM_DRAW);
    programs.ground.use(this.tile, { tile: [this.tiles, 3, gl.FLOAT, false, 0, 0] });
    gl.enable(gl.CULL_FACE);
    gl.drawElementsInstanced(gl.TRIANGLES, this.tile.count, gl.UNSIGNED_SHORT, 0, tiles.length / 3);
    gl.disable(gl.CULL_FACE);
    drawMesh(meshes.surroundings, programs.mesh);
    drawMesh(meshes.built, programs.mesh);
    this.plants?.drawSeen(camera);
    gl.depthFunc(gl.LEQUAL);
    programs.sky.use();
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.depthFunc(gl.LESS);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    drawMesh(meshes.water, programs.water);
    return tiles.length / 3;
  }
}

// Four channels of smooth noise that repeats, in octaves from a quarter of the side on.
function smoothNoise(side) {
  const sum = new Float32Array(4 * side * side);
  let seed = 1;
  for (let cells = 4, share = 280; cells <= side / 4; cells *= 2, share *= 0.6) {
    const random = Float32Array.from({ length: 4 * cells * cells }, () => (seed = (seed * 48271) % 2147483647) / 2147483647 - 0.5);
    const ease = Float32Array.from({ length: side }, (_, k) => { const t = ((k * cells) / side) % 1; return t * t * (3 - 2 * t); });
    for (let at = 0; at < sum.length; at++) {
      const [channel, column, row] = [at & 3, (at >> 2) % side, Math.floor(at / (4 * side))];
      const [i, j, u, v] = [Math.floor((column * cells) / side), Math.floor((row * cells) / side), ease[column], ease[row]];
      const corner = (a, b) => random[4 * (((j + b) % cells) * cells + ((i + a) % cells)) + channel];
      sum[at] += share * ((corner(0, 0) * (1 - u) + corner(1, 0) * u) * (1 - v) + (corner(0, 1) * (1 - u) + corner(1, 1) * u) * v);
    }
  }
  return new Uint8Array(Uint8ClampedArray.from(sum, (value) => 127.5 + value).buffer);
}

async function show() {
  const element = (id) => document.getElementById(id);
  const canvas = element("view");
  const gl = canvas.getContext("webgl2", { alpha: false, powerPreference: "high-performance" });
  if (!gl) throw new Error("This browser has no WebGL 2, which the page needs.");
  const { facts: scene, sky } = await load("scene");
  document.title = element("title").textContent = scene.title;
  const [azimuth, rise] = [scene.view.sun_azimuth, scene.view.sun_elevation].map((degrees) => (degrees * Math.PI) / 180);
  scene.toSun = [Math.sin(azimuth) * Math.cos(rise), Math.cos(azimuth) * Math.cos(rise), Math.sin(rise)];
  const coming = Object.fromEntries(scene.files.map((name) => [name, load(name)]));
  for (const promise of Object.values(coming)) promise.catch(() => {}); // raised where it is awaited
  const page = new Page(gl, scene, sky);
  const stats = Object.assign(sketchterrain.stats, { frames: 0, frame: 0, tiles: 0, plants: 0 });
  let [scheduled, whole, before] = [false, false, 0]; // until the data are whole, software draws few pixels
  const paint = (now) => {
    scheduled = false;
    if (!page.ground) return;
    const ratio = Math.min(devicePixelRatio, 2) * (!page.software ? 1 : whole ? 0.6 : 0.25);
    const size = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(Math.round(side * ratio), 1));
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const start = performance.now();
    const moving = camera.step(Math.min((now - before) / 1000, 0.1));
    stats.tiles = page.draw(camera);
    if (sketchterrain.timed) gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits for the frame
    Object.assign(stats, { frame: performance.now() - start, frames: stats.frames + 1, plants: page.plants?.shown ?? 0 });
    before = now;
    for (const mode of ["orbit", "walk"]) element(mode).setAttribute("aria-pressed", camera.mode === mode);
    if (moving) change();
  };
  const change = () => {
    if (!scheduled) requestAnimationFrame(paint); // browsers call it only while the page is visible
    scheduled = true;
  };
  const camera = new Camera(scene, canvas, change);
  Object.assign(sketchterrain, { camera, page, change });
  camera.readHash(location.hash);
  controls(camera, element);
  new ResizeObserver(change).observe(canvas);
  canvas.addEventListener("webglcontextlost", () => report("The graphics card was reset: reload the page."));

  const side = (count) => Math.ceil((count - 1) / scene.grid.step) + 1;
  let level = { columns: side(scene.grid.columns), rows: side(scene.grid.rows), numbers: (await coming.coarse).heights };
  page.setWeights((await coming.coarse).weights, level);
  await page.setColours((await coming.textures).webp);
  for (const program of Object.values(page.programs)) program.finish();
  page.setGround(new Ground(scene, level, scene.grid.step));
  change();
  stats.first = performance.now();
  for (const name of ["surroundings", "water", "built"]) if (coming[name]) page.meshes[name] = page.dataMesh(await coming[name]);
  if (coming.foliage) {
    page.plants = new Plants(page, await coming.models, await coming.foliage);
    page.setTexture("cover", gl.TEXTURE_2D, gl.R8, [512, 512], page.plants.cover(512), { filter: gl.LINEAR });
  }
  for (let number = 1; number <= scene.grid.levels; number++) {
    level = finerLevel(level, (await coming[`heights${number}`]).rest);
    page.setGround(new Ground(scene, level, scene.grid.step >> number));
    if (!page.software) change();
    await new Promise((resolve) => setTimeout(resolve));
  }
  const { weights, painted } = await coming.weights;
  page.setWeights(weights, level);
  if (painted) page.setTexture("painted", gl.TEXTURE_2D, gl.RGBA8, [level.columns, level.rows], painted, { filter: gl.LINEAR });
  whole = true;
  change();
  await new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve)));
  element("message").hidden = true;
  stats.complete = performance.now();
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const animate = () => {
    if (!still.matches && page.meshes.water) change(); // waves
    setTimeout(animate, Math.max(80, 4 * stats.frame));
  };
  animate();
}

globalThis.sketchterrain = { stats: {} };
sketchterrain.ready = show();
sketchterrain.ready.catch((error) => error instanceof Error && report(error.message));
