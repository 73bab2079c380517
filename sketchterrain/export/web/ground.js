"use strict";
// Heights: levels from residuals, light on the ground, and a quadtree of tiles by their error on the screen.

const TILE = 32; // quads along a tile's side

// A cubic between a number and the next of a line, `stride` apart; integers as in export/web_data.py.
function between(values, at, stride, number, count) {
  const a = values[at - (number > 0 ? stride : 0)];
  const d = values[at + (number + 2 < count ? 2 : 1) * stride];
  return (9 * (values[at] + values[at + stride]) - a - d + 8) >> 4;
}

// The next finer level of numbers, from the coarser one and its residuals.
function finerLevel({ columns, rows, numbers }, rest) {
  const wide = 2 * columns - 1;
  const high = 2 * rows - 1;
  const fine = new Uint16Array(wide * high);
  const signed = (value) => (value >> 1) ^ -(value & 1);
  let next = 0;
  for (let row = 0; row < rows; row++)
    for (let column = 0; column < columns; column++) fine[2 * (row * wide + column)] = numbers[row * columns + column];
  for (let row = 0; row < rows - 1; row++)
    for (let column = 0; column < columns; column++) {
      const at = 2 * (row * wide + column);
      fine[at + wide] = between(fine, at, 2 * wide, row, rows) + signed(rest[next++]);
    }
  for (let row = 0; row < high; row++)
    for (let column = 0; column < columns - 1; column++) {
      const at = row * wide + 2 * column;
      fine[at + 1] = between(fine, at, 2, column, columns) + signed(rest[next++]);
    }
  return { columns: wide, rows: high, numbers: fine };
}

class Ground {
  // `step`: vertices of the finest level between those of this one.
  constructor(scene, level, step) {
    Object.assign(this, level, { step, size: scene.size });
    this.cell = [(step * scene.size[0]) / (scene.columns - 1), (step * scene.size[1]) / (scene.rows - 1)];
    this.height = Float32Array.from(level.numbers, (number) => scene.low + scene.metres * number);
    this.tree = this.measuredTree();
  }

  // Bilinear, at metres from the south-west corner.
  heightAt(x, y) {
    const limit = (value, most) => Math.min(Math.max(value, 0), most);
    const column = limit(x / this.cell[0], this.columns - 1.001);
    const row = limit((this.size[1] - y) / this.cell[1], this.rows - 1.001);
    const at = Math.floor(row) * this.columns + Math.floor(column);
    const [right, down] = [column % 1, row % 1];
    const mix = (a, b, share) => a + share * (b - a);
    const upper = mix(this.height[at], this.height[at + 1], right);
    return mix(upper, mix(this.height[at + this.columns], this.height[at + this.columns + 1], right), down);
  }

  // For each level of tiles the lowest and highest point and the error of each tile, finest level first.
  measuredTree() {
    const { columns, rows, height } = this;
    const levels = [];
    for (let step = 1, last = false; !last; step *= 2) {
      const span = TILE * step;
      const across = Math.max(Math.ceil((columns - 1) / span), 1);
      const down = Math.max(Math.ceil((rows - 1) / span), 1);
      last = across === 1 && down === 1;
      const tiles = new Float32Array(3 * across * down);
      const below = levels.at(-1);
      for (let j = 0; j < down; j++)
        for (let i = 0; i < across; i++) {
          let [low, high, error] = [Infinity, -Infinity, 0];
          if (below) {
            for (const [x, y] of [[0, 0], [1, 0], [0, 1], [1, 1]]) {
              if (2 * i + x >= below.across || 2 * j + y >= below.down) continue;
              const at = 3 * ((2 * j + y) * below.across + 2 * i + x);
              low = Math.min(low, below.tiles[at]);
              high = Math.max(high, below.tiles[at + 1]);
              error = Math.max(error, below.tiles[at + 2]);
            }
            error += this.midpointError(i * span, j * span, span, step);
          } else {
            for (let row = j * span; row <= Math.min(j * span + span, rows - 1); row++)
              for (let column = i * span; column <= Math.min(i * span + span, columns - 1); column++) {
                const value = height[row * columns + column];
                low = Math.min(low, value);
                high = Math.max(high, value);
              }
          }
          tiles.set([low, high, error], 3 * (j * across + i));
        }
      levels.push({ across, down, step, tiles });
    }
    return levels;
  }

  // How far vertices half a step apart are from the edges between those a step apart.
  midpointError(left, top, span, step) {
    const { columns, rows, height } = this;
    const half = step / 2;
    let worst = 0;
    const right = Math.min(left + span, columns - 1);
    const bottom = Math.min(top + span, rows - 1);
    for (let row = top; row <= bottom; row += step)
      for (let column = left + half; column + half <= right; column += step) {
        const at = row * columns + column;
        worst = Math.max(worst, Math.abs(height[at] - 0.5 * (height[at - half] + height[at + half])));
      }
    const line = half * columns;
    for (let row = top + half; row + half <= bottom; row += step)
      for (let column = left; column <= right; column += half) {
        const at = row * columns + column;
        worst = Math.max(worst, Math.abs(height[at] - 0.5 * (height[at - line] + height[at + line])));
      }
    return worst;
  }

  // Tiles to draw, [column, row, step] each: split where the error is larger than so many pixels.
  visibleTiles(camera, pixels) {
    const found = [];
    const [width, depth] = this.cell;
    const visit = (level, i, j) => {
      const { across, down, step, tiles } = this.tree[level];
      if (i >= across || j >= down) return;
      const [low, high, error] = tiles.subarray(3 * (j * across + i), 3 * (j * across + i) + 3);
      const span = TILE * step;
      const west = i * span * width - camera.eye[0];
      const north = this.size[1] - j * span * depth - camera.eye[1];
      const half = [0.5 * span * width, 0.5 * span * depth, 0.5 * (high - low)];
      const middle = [west + half[0], north - half[1], low + half[2] - camera.eye[2]];
      if (!camera.sees(middle, Math.hypot(...half))) return;
      const away = Math.hypot(...middle.map((value, k) => Math.max(Math.abs(value) - half[k], 0)));
      if (level > 0 && error * camera.pixelsPerRadian > pixels * away)
        for (const [x, y] of [[0, 0], [1, 0], [0, 1], [1, 1]]) visit(level - 1, 2 * i + x, 2 * j + y);
      else found.push([away, i * span, j * span, step]);
    };
    visit(this.tree.length - 1, 0, 0);
    found.sort((a, b) => a[0] - b[0]); // what is near hides the rest
    return new Float32Array(found.flatMap((tile) => tile.slice(1)));
  }

  // Normals (east, north) and visible shares of sun and sky as bytes.
  surface(toSun) {
    const { columns, rows, height, cell } = this;
    const result = new Uint8Array(4 * columns * rows);
    const sun = this.sunlight(toSun);
    const hollow = [3, 12].map((radius) => ({ radius, mean: this.blurred(radius) }));
    for (let row = 0, at = 0; row < rows; row++)
      for (let column = 0; column < columns; column++, at++) {
        const [west, east] = [column > 0 ? 1 : 0, column + 1 < columns ? 1 : 0];
        const [north, south] = [row > 0 ? columns : 0, row + 1 < rows ? columns : 0];
        const x = (height[at - west] - height[at + east]) / ((west + east) * cell[0]);
        const y = (height[at + south] - height[at - north]) / (((north + south) / columns) * cell[1]);
        const scale = 127.5 / Math.hypot(x, y, 1);
        let sky = 1;
        for (const { radius, mean } of hollow) sky -= 0.9 * Math.max((mean[at] - height[at]) / (radius * cell[0]), 0);
        result[4 * at] = 127.5 + x * scale;
        result[4 * at + 1] = 127.5 + y * scale;
        result[4 * at + 2] = 255 * sun[at];
        result[4 * at + 3] = 255 * Math.min(Math.max(sky, 0.3), 1);
      }
    return result;
  }

  // Visible share of the sun: a sweep away from it that carries the height of the shadow.
  sunlight([x, y, z]) {
    const { columns, rows, height } = this;
    const along = Math.abs(x) * this.cell[1] >= Math.abs(y) * this.cell[0];
    const [count, width, major, minor] = along ? [columns, rows, 1, columns] : [rows, columns, columns, 1];
    const ahead = (along ? x > 0 : y < 0) ? 1 : -1; // towards the sun, in lines
    const aside = along ? ((-y / Math.abs(x)) * this.cell[0]) / this.cell[1] : ((x / Math.abs(y)) * this.cell[1]) / this.cell[0];
    const drop = (z * (along ? this.cell[0] : this.cell[1])) / Math.max(Math.abs(along ? x : y), 1e-6);
    const share = new Float32Array(height.length);
    let before = null;
    for (let k = 0; k < count; k++) {
      const line = (ahead > 0 ? count - 1 - k : k) * major;
      const now = new Float32Array(width);
      for (let i = 0; i < width; i++) {
        const at = line + i * minor;
        const place = Math.min(Math.max(i + aside, 0), width - 1);
        const first = Math.min(Math.floor(place), width - 2);
        const shade = before ? before[first] + (place - first) * (before[first + 1] - before[first]) - drop : -Infinity;
        share[at] = Math.min(Math.max(0.9 + (height[at] - shade) / (0.35 * drop + 1), 0), 1);
        now[i] = Math.max(shade, height[at]);
      }
      before = now;
    }
    return share;
  }

  // Mean height within some texels along both axes.
  blurred(radius) {
    const { columns, rows } = this;
    const pass = (from, count, lines, stride, next) => {
      const to = new Float32Array(from.length);
      for (let line = 0; line < lines; line++) {
        const value = (k) => from[line * next + Math.min(Math.max(k, 0), count - 1) * stride];
        let sum = 0;
        for (let k = -radius; k <= radius; k++) sum += value(k);
        for (let k = 0; k < count; k++) {
          to[line * next + k * stride] = sum / (2 * radius + 1);
          sum += value(k + radius + 1) - value(k - radius);
        }
      }
      return to;
    };
    return pass(pass(this.height, columns, rows, 1, columns), rows, columns, columns, 1);
  }
}

// Vertices of a tile, (column, row, 1 at the foot of its skirt) each, and its triangles.
function tileMesh() {
  const corners = [];
  const triangles = [];
  const quad = (a, b, c, d) => triangles.push(a, b, c, a, c, d);
  for (let row = 0; row <= TILE; row++) for (let column = 0; column <= TILE; column++) corners.push(column, row, 0);
  const at = (column, row) => row * (TILE + 1) + column;
  for (let row = 0; row < TILE; row++)
    for (let column = 0; column < TILE; column++)
      quad(at(column, row), at(column, row + 1), at(column + 1, row + 1), at(column + 1, row));
  const edges = [(k) => [k, 0], (k) => [TILE, k], (k) => [TILE - k, TILE], (k) => [0, TILE - k]];
  for (const edge of edges)
    for (let k = 0; k <= TILE; k++) {
      const foot = corners.length / 3;
      corners.push(...edge(k), 1);
      if (k < TILE) quad(at(...edge(k)), at(...edge(k + 1)), foot + 1, foot);
    }
  return { corners: new Float32Array(corners), triangles: new Uint16Array(triangles) };
}
