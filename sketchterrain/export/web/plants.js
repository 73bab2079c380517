"use strict";
// Plants: models near the eye, pictures of them farther away, and a map of their shadows around the eye.

const [CELLS, PICTURE, SHADOW] = [64, 128, 2048]; // a side, as in export/targets/web.py; px; px
const [NEAR, MIDDLE, THIN] = [55, 190, 2500]; // m up to which models are fine, are models, and all plants are drawn

class Plants {
  constructor(page, models, foliage) {
    Object.assign(this, { page, gl: page.gl, models: page.scene.models, foliage, count: foliage.x.length, runs: [], shown: 0 });
    this.mesh = page.mesh({ corner: models.corner, normal: models.normal, tint: models.tint }, null, true);
    let next = 0;
    this.first = this.models.map(({ vertices }) => vertices.map((count) => (next += count) - count));
    this.packed = new Uint16Array(4 * this.count); // place and height; scale and turn
    for (let k = 0, key = null; k < this.count; k++) {
      const [i, j, model] = [foliage.x[k] >> 10, foliage.y[k] >> 10, foliage.model[k]];
      if (key !== (key = (i * CELLS + j) * 256 + model)) this.runs.push({ first: k, count: 0, model, cell: [i, j] });
      this.runs.at(-1).count++;
    }
    this.instances = this.gl.createBuffer();
    this.drawPictures(models.tint);
    const { gl } = this;
    this.shadow = page.texture(gl.TEXTURE_2D, gl.DEPTH_COMPONENT24, [SHADOW, SHADOW], null, { compare: true });
    this.shadowFrame = page.framebuffer([[gl.DEPTH_ATTACHMENT, this.shadow]]);
  }

  place(k) {
    const { size, low, metres } = this.page.scene;
    return [(this.packed[4 * k] / 65535) * size[0], (this.packed[4 * k + 1] / 65535) * size[1], low + metres * this.packed[4 * k + 2]];
  }

  // Stand on the ground that has arrived.
  settle(ground) {
    const { x, y, scale, turn } = this.foliage;
    const { low, metres, size } = this.page.scene;
    for (let k = 0; k < this.count; k++) {
      const height = ground.heightAt((x[k] / 65535) * size[0], (y[k] / 65535) * size[1]);
      this.packed.set([x[k], y[k], Math.round((height - low) / metres), scale[k] | (turn[k] << 8)], 4 * k);
    }
    for (const run of this.runs) run.middle = this.place(run.first + (run.count >> 1));
  }

  // Share of the ground under plants, bytes of a square of so many texels a side.
  cover(side) {
    const share = new Float32Array(side * side);
    const { size, largestPlant } = this.page.scene;
    for (let k = 0; k < this.count; k++) {
      const radius = 0.24 * this.models[this.foliage.model[k]].size * (this.foliage.scale[k] / 255) * largestPlant;
      const [x, y] = [(this.foliage.x[k] / 65536) * (side - 1), (1 - (this.foliage.y[k] + 1) / 65536) * (side - 1)];
      const part = Math.PI * radius * radius * (side / size[0]) * (side / size[1]);
      for (let j = 0; j < 4; j++)
        share[((y | 0) + (j >> 1)) * side + (x | 0) + (j & 1)] += part * Math.abs(1 - (j & 1) - (x % 1)) * Math.abs(1 - (j >> 1) - (y % 1));
    }
    return Uint8Array.from(share, (value) => 255 * (1 - Math.exp(-value)));
  }

  // Draw plants up to a distance from a place, as the level of `levelAt` their distance.
  draw({ eye, sees }, farthest, levelAt) {
    const { gl, page } = this;
    const { low, metres, largestPlant, size } = page.scene;
    const groups = this.models.map(() => [[], [], [], []]);
    const radius = Math.max(...size) / CELLS + 30;
    for (const run of this.runs) {
      const offset = run.middle.map((value, k) => value - eye[k]);
      const away = Math.hypot(...offset);
      if (away - radius > farthest || !sees(offset, radius)) continue;
      if (levelAt(away - radius) === levelAt(away + radius))
        groups[run.model][levelAt(away)].push(run.first, Math.ceil(run.count * clamp(THIN / away, 0.3, 1)));
      else for (let k = run.first; k < run.first + run.count; k++)
          groups[run.model][levelAt(Math.hypot(...this.place(k).map((value, axis) => value - eye[axis])))].push(k, 1);
    }
    const chosen = new Uint16Array(4 * this.count);
    const ranges = [];
    let next = 0;
    groups.forEach((levels, model) => levels.forEach((list, level) => {
        const first = next;
        for (let k = 0; k < list.length; next += list[k + 1], k += 2) chosen.set(this.packed.subarray(4 * list[k], 4 * (list[k] + list[k + 1])), 4 * next);
        if (next > first) ranges.push([model, level, first, next - first]);
      }));
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.bufferData(gl.ARRAY_BUFFER, chosen.subarray(0, 4 * next), gl.STREAM_DRAW);
    for (const [model, level, first, count] of ranges) {
      const program = page.programs[["plants", "plants", "shadow", "impostors"][level]];
      const instances = { place: [this.instances, 3, gl.UNSIGNED_SHORT, true, 8, 8 * first], growth: [this.instances, 2, gl.UNSIGNED_BYTE, true, 8, 8 * first + 6] };
      program.use(level === 3 ? page.square : this.mesh, instances);
      gl.uniform4f(program.uniform("model"), this.models[model].size * largestPlant, low, metres * 65535, model);
      if (level === 3) gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
      else gl.drawArraysInstanced(gl.TRIANGLES, this.first[model][level], this.models[model].vertices[level], count);
    }
    return next;
  }

  drawSeen(camera) {
    this.shown = this.draw({ eye: camera.eye, sees: (...sphere) => camera.sees(...sphere) }, Infinity, (away) => (away < NEAR ? 0 : away < MIDDLE ? 1 : 3));
  }

  drawShadows(middle, radius) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowFrame);
    gl.viewport(0, 0, SHADOW, SHADOW);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    this.draw({ eye: middle, sees: () => true }, 1.5 * radius, () => 2);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // Pictures of up to 25 models from the side, and their normals.
  drawPictures(tint) {
    const { gl, page } = this;
    const side = 5 * PICTURE;
    const parts = [0, 1].map(() => page.texture(gl.TEXTURE_2D, gl.RGBA8, [side, side], null, { filter: gl.LINEAR_MIPMAP_LINEAR }));
    const depth = page.texture(gl.TEXTURE_2D, gl.DEPTH_COMPONENT24, [side, side], null, {});
    const frame = page.framebuffer([[gl.COLOR_ATTACHMENT0, parts[0]], [gl.COLOR_ATTACHMENT1, parts[1]], [gl.DEPTH_ATTACHMENT, depth]]);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.SCISSOR_TEST);
    page.programs.picture.use(this.mesh);
    this.models.forEach(({ vertices }, k) => {
      const place = [(k % 5) * PICTURE, Math.floor(k / 5) * PICTURE, PICTURE, PICTURE];
      gl.viewport(...place);
      gl.scissor(...place);
      const mean = (axis) => {
        const from = (axis * tint.length) / 3 + this.first[k][0];
        return tint.subarray(from, from + vertices[0]).reduce((sum, value) => sum + value, 0) / vertices[0] / 255;
      };
      gl.clearBufferfv(gl.COLOR, 0, [mean(0), mean(1), mean(2), 0]); // so that edges are not dark
      gl.clearBufferfv(gl.COLOR, 1, [0.5, 0.7, 0.8, 0]);
      gl.drawArrays(gl.TRIANGLES, this.first[k][0], vertices[0]);
    });
    gl.disable(gl.SCISSOR_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(frame);
    for (const each of parts) page.mipmaps(each);
    [page.textures.pictures, page.textures.normals] = parts;
  }
}
