"use strict";
// Plants: instances of models near the eye, pictures of them farther away, and a map of the shadows around the eye.

const CELLS = 64; // along a side, as in export/targets/web.py
const PICTURE = 128; // px
const SHADOW = 2048; // px

class Plants {
  constructor(page, models, foliage) {
    const { gl, scene } = page;
    Object.assign(this, { page, gl, models: scene.models, count: foliage.x.length, drawn: 0 });
    this.mesh = page.buffers({ corner: [models.position, gl.SHORT], normal: [models.normal, gl.BYTE], tint: [models.colour, gl.UNSIGNED_BYTE] }, true);
    this.first = []; // vertices of each level of each model
    let next = 0;
    for (const model of this.models) this.first.push(model.vertices.map((count) => (next += count) - count));
    this.foliage = foliage;
    this.packed = new Uint16Array(4 * this.count); // place and height, scale and turn
    this.runs = []; // of plants of a model in a cell
    const cellOf = (k) => [foliage.x[k] >> 10, foliage.y[k] >> 10, foliage.model[k]].join();
    for (let k = 0; k < this.count; k++) {
      if (k === 0 || cellOf(k) !== cellOf(k - 1)) this.runs.push({ first: k, count: 0, model: foliage.model[k], cell: [foliage.x[k] >> 10, foliage.y[k] >> 10] });
      this.runs.at(-1).count++;
    }
    this.instances = gl.createBuffer();
    this.drawPictures();
  }

  // Stand on the ground at hand.
  settle(ground) {
    const { x, y, scale, turn } = this.foliage;
    const { size, low, metres } = this.page.scene;
    for (let k = 0; k < this.count; k++) {
      const height = ground.heightAt((x[k] / 65535) * size[0], (y[k] / 65535) * size[1]);
      this.packed.set([x[k], y[k], Math.round((height - low) / metres), scale[k] | (turn[k] << 8)], 4 * k);
    }
    for (const run of this.runs) {
      const [x, y] = run.cell.map((number, axis) => ((number + 0.5) / CELLS) * size[axis]);
      run.middle = [x, y, ground.heightAt(x, y)];
    }
  }

  // Share of the ground under plants, for its light: bytes of a side of 512.
  cover() {
    const { x, y, scale, model } = this.foliage;
    const { size, largestPlant } = this.page.scene;
    const share = new Float32Array(512 * 512);
    for (let k = 0; k < this.count; k++) {
      const radius = 0.24 * this.models[model[k]].size * (scale[k] / 255) * largestPlant;
      const [column, row] = [Math.min((x[k] / 65535) * 511, 510.99), Math.min((1 - y[k] / 65535) * 511, 510.99)];
      const part = (Math.PI * radius * radius * 512 * 512) / (size[0] * size[1]);
      for (const [i, j] of [[0, 0], [1, 0], [0, 1], [1, 1]])
        share[((row | 0) + j) * 512 + (column | 0) + i] += part * Math.abs(1 - i - (column % 1)) * Math.abs(1 - j - (row % 1));
    }
    return Uint8Array.from(share, (value) => 255 * (1 - Math.exp(-value)));
  }

  // Select plants by distance for each model and level, into one buffer; return ranges [model, level, first, count].
  select(camera, { near, middle, far = Infinity, coarse = 2 }) {
    const groups = this.models.map(() => [[], [], []]);
    const radius = (0.75 * Math.max(...this.page.scene.size)) / CELLS + 30;
    for (const run of this.runs) {
      const offset = run.middle.map((value, k) => value - camera.eye[k]);
      const away = Math.hypot(...offset);
      if (away - radius > far || !camera.sees(offset, radius)) continue;
      if (away - radius < middle) {
        const { size, low, metres } = this.page.scene;
        for (let k = run.first; k < run.first + run.count; k++) {
          const [x, y, z] = this.packed.subarray(4 * k, 4 * k + 3);
          const own = Math.hypot((x / 65535) * size[0] - camera.eye[0], (y / 65535) * size[1] - camera.eye[1], low + metres * z - camera.eye[2]);
          if (own < far) groups[run.model][own < near ? 0 : own < middle ? 1 : coarse].push(k, 1);
        }
      } else groups[run.model][coarse].push(run.first, Math.ceil(run.count * Math.min(1, Math.max(0.3, 2500 / away))));
    }
    const ranges = [];
    const chosen = new Uint16Array(4 * this.count);
    let next = 0;
    groups.forEach((levels, model) =>
      levels.forEach((list, level) => {
        const first = next;
        for (let k = 0; k < list.length; k += 2) {
          chosen.set(this.packed.subarray(4 * list[k], 4 * (list[k] + list[k + 1])), 4 * next);
          next += list[k + 1];
        }
        if (next > first) ranges.push([model, level, first, next - first]);
      }),
    );
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.instances);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, chosen.subarray(0, 4 * next), this.gl.STREAM_DRAW);
    return ranges;
  }

  drawRanges(ranges, models, pictures) {
    const { gl, page } = this;
    const { low, metres, largestPlant } = page.scene;
    for (const [model, level, first, count] of ranges) {
      const flat = level === 2;
      const program = (flat ? pictures : models).use();
      program.set({ growing: [this.models[model].size * largestPlant, low, metres * 65535] });
      if (flat) {
        const [i, j] = [model % this.across, Math.floor(model / this.across)];
        program.set({ picture: [i / this.across, j / this.across, 1 / this.across, 1 / this.across] });
      }
      program.attributes(flat ? page.square : this.mesh, {
        place: [this.instances, 3, gl.UNSIGNED_SHORT, true, 8, 8 * first],
        growth: [this.instances, 2, gl.UNSIGNED_BYTE, true, 8, 8 * first + 6],
      });
      if (flat) gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
      else gl.drawArraysInstanced(gl.TRIANGLES, this.first[model][level], this.models[model].vertices[level], count);
    }
  }

  draw(camera) {
    const ranges = this.select(camera, { near: 55, middle: 190 });
    this.drawn = ranges.reduce((sum, range) => sum + range[3], 0);
    this.drawRanges(ranges, this.page.programs.plants, this.page.programs.impostors);
  }

  // A map of the shadows within a radius of the eye, and its matrix.
  drawShadows(camera, radius) {
    const { gl, page } = this;
    if (!this.shadow) {
      this.shadow = page.texture(gl.TEXTURE_2D, gl.DEPTH_COMPONENT24, [SHADOW, SHADOW], null, { filter: gl.LINEAR, compare: true });
      this.shadowFrame = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadow.name, 0);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.viewport(0, 0, SHADOW, SHADOW);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const everywhere = { eye: camera.eye, sees: () => true };
    const ranges = this.select(everywhere, { near: 0, middle: radius > 400 ? 0 : radius, far: 1.5 * radius, coarse: radius > 400 ? 1 : 1 });
    this.drawRanges(ranges, page.programs.shadow, page.programs.shadow);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // Pictures of all models from the side, and of their normals.
  drawPictures() {
    const { gl, page } = this;
    this.across = Math.ceil(Math.sqrt(this.models.length));
    const side = PICTURE * this.across;
    this.pictures = [0, 1].map(() => page.texture(gl.TEXTURE_2D, gl.RGBA8, [side, side], null, { filter: gl.LINEAR_MIPMAP_LINEAR }));
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    this.pictures.forEach((each, k) => gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + k, gl.TEXTURE_2D, each.name, 0));
    const depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT16, side, side);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const program = page.programs.picture.use();
    program.attributes(this.mesh, {});
    const { colour } = this.mesh.arrays;
    this.models.forEach((model, k) => {
      const place = [(k % this.across) * PICTURE, Math.floor(k / this.across) * PICTURE, PICTURE, PICTURE];
      gl.viewport(...place);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(...place);
      const middle = [0, 1, 2].map((axis) => {
        const values = colour.subarray(axis * (colour.length / 3)).subarray(this.first[k][0], this.first[k][0] + model.vertices[0]);
        return values.reduce((sum, value) => sum + value, 0) / values.length / 255;
      });
      gl.clearBufferfv(gl.COLOR, 0, [...middle, 0]);
      gl.clearBufferfv(gl.COLOR, 1, [0.5, 0.7, 0.8, 0]);
      gl.drawArrays(gl.TRIANGLES, this.first[k][0], model.vertices[0]);
    });
    gl.disable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(frame);
    for (const each of this.pictures) page.mipmaps(each);
    [page.textures.pictures, page.textures.normals] = this.pictures;
  }
}
