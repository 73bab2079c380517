"use strict";
// Heights level by level, sunlight on the ground, and a quadtree of tiles by their error on the screen.

const TILE = 32; // quads along a tile's side
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

// The next finer level of a grid's numbers from its residuals, see height_levels in export/targets/web.py.
function finerLevel({ columns, rows, numbers }, rest) {
  const [wide, high] = [2 * columns - 1, 2 * rows - 1];
  const fine = new Uint16Array(wide * high);
  let next = 0;
  const fill = (at, stride, number, count) => {
    const [a, d] = [fine[at - (number > 0 ? stride : 0)], fine[at + (number + 2 < count ? 2 : 1) * stride]];
    const residual = rest[next++];
    fine[at + stride / 2] = ((9 * (fine[at] + fine[at + stride]) - a - d + 8) >> 4) + ((residual >> 1) ^ -(residual & 1));
  };
  for (let j = 0; j < rows; j++) for (let i = 0; i < columns; i++) fine[2 * (j * wide + i)] = numbers[j * columns + i];
  for (let j = 0; j < rows - 1; j++) for (let i = 0; i < columns; i++) fill(2 * (j * wide + i), 2 * wide, j, rows);
  for (let j = 0; j < high; j++) for (let i = 0; i < columns - 1; i++) fill(j * wide + 2 * i, 2, i, columns);
  return { columns: wide, rows: high, numbers: fine };
}

class Ground {
  constructor({ size, grid, low, metres }, level, step) {
    Object.assign(this, level, { size, cell: [(step * size[0]) / (grid.columns - 1), (step * size[1]) / (grid.rows - 1)] });
    this.height = Float32Array.from(level.numbers, (number) => low + metres * number);
    this.levels = this.measure();
  }

  // Bilinear, at metres from the south-west corner.
  heightAt(x, y) {
    const [column, row] = [clamp(x / this.cell[0], 0, this.columns - 1.001), clamp((this.size[1] - y) / this.cell[1], 0, this.rows - 1.001)];
    const [at, right, down] = [Math.floor(row) * this.columns + Math.floor(column), column % 1, row % 1];
    const along = (first) => this.height[first] + right * (this.height[first + 1] - this.height[first]);
    return along(at) + down * (along(at + this.columns) - along(at));
  }

  // Levels of tiles, finest first: each tile's lowest and highest point and its error, m.
  measure() {
    const { columns, rows, height } = this;
    const levels = [];
    for (let step = 1, last = false; !last; step *= 2) {
      const [span, half, below] = [TILE * step, step / 2, levels.at(-1)];
      const [across, down] = [columns, rows].map((side) => Math.max(Math.ceil((side - 1) / span), 1));
      last = across === 1 && down === 1;
      const tiles = Array.from({ length: across * down }, (_, k) => {
        const [left, top] = [(k % across) * span, Math.floor(k / across) * span];
        const tile = { low: Infinity, high: -Infinity, error: 0 };
        for (let row = top; row <= Math.min(top + span, rows - 1); row += step)
          for (let column = left; column <= Math.min(left + span, columns - 1); column += step) {
            const [at, right, lower] = [row * columns + column, column + step < columns, row + step < rows];
            const off = (stride) => Math.abs(height[at + half * stride] - 0.5 * (height[at] + height[at + step * stride]));
            if (below) tile.error = Math.max(tile.error, right ? off(1) : 0, lower ? off(columns) : 0, right && lower ? off(columns + 1) : 0);
            tile.low = Math.min(tile.low, height[at]);
            tile.high = Math.max(tile.high, height[at]);
          }
        let worst = 0;
        for (let j = 0; below && j < 4; j++) {
          const [x, y] = [2 * (k % across) + (j & 1), 2 * Math.floor(k / across) + (j >> 1)];
          if (x < below.across && y < below.down) worst = Math.max(worst, below.tiles[y * below.across + x].error);
        }
        tile.error += worst;
        return tile;
      });
      levels.push({ across, down, step, tiles });
    }
    return levels;
  }

  // Tiles to draw, [column, row, step] each, split while their error is more than so many pixels; nearest first.
  visibleTiles(camera, pixels) {
    const found = [];
    const visit = (level, i, j) => {
      const { across, down, step, tiles } = this.levels[level];
      if (i >= across || j >= down) return;
      const { low, high, error } = tiles[j * across + i];
      const span = TILE * step;
      const half = [0.5 * span * this.cell[0], 0.5 * span * this.cell[1], 0.5 * (high - low) + error];
      const middle = [(2 * i + 1) * half[0], this.size[1] - (2 * j + 1) * half[1], 0.5 * (low + high)].map((v, k) => v - camera.eye[k]);
      if (!camera.sees(middle, Math.hypot(...half))) return;
      const away = Math.hypot(...middle.map((value, k) => Math.max(Math.abs(value) - half[k], 0)));
      if (level > 0 && error * camera.pixelsPerRadian > pixels * away) for (let k = 0; k < 4; k++) visit(level - 1, 2 * i + (k & 1), 2 * j + (k >> 1));
      else found.push([away, i * span, j * span, step]);
    };
    visit(this.levels.length - 1, 0, 0);
    return new Float32Array(found.sort((a, b) => a[0] - b[0]).flatMap((tile) => tile.slice(1)));
  }

  // Normals (east, north) and the visible share of the sun as bytes of four.
  surface(toSun) {
    const { columns, rows, height, cell } = this;
    const bytes = new Uint8Array(4 * columns * rows);
    const sun = this.sunlight(toSun);
    for (let row = 0, at = 0; row < rows; row++)
      for (let column = 0; column < columns; column++, at++) {
        const west = column > 0 ? 1 : 0;
        const east = column + 1 < columns ? 1 : 0;
        const north = row > 0 ? 1 : 0;
        const south = row + 1 < rows ? 1 : 0;
        const x = (height[at - west] - height[at + east]) / ((west + east) * cell[0]);
        const y = (height[at + south * columns] - height[at - north * columns]) / ((north + south) * cell[1]);
        const scale = 127.5 / Math.sqrt(x * x + y * y + 1);
        bytes[4 * at] = 127.5 + x * scale;
        bytes[4 * at + 1] = 127.5 + y * scale;
        bytes[4 * at + 2] = 255 * sun[at];
      }
    return bytes;
  }

  // Visible share of the sun: lines swept away from it carry the height of the shadow.
  sunlight([x, y, z]) {
    const { columns, rows, height, cell } = this;
    const along = Math.abs(x) * cell[1] >= Math.abs(y) * cell[0];
    const [count, width, major, minor] = along ? [columns, rows, 1, columns] : [rows, columns, columns, 1];
    const forward = along ? x < 0 : y > 0; // whether the sun is behind the first line
    const aside = along ? (-y / Math.abs(x)) * (cell[0] / cell[1]) : (x / Math.abs(y)) * (cell[1] / cell[0]);
    const drop = along ? (z * cell[0]) / Math.abs(x) : (z * cell[1]) / Math.max(Math.abs(y), 1e-6);
    const share = new Float32Array(height.length);
    let before = new Float32Array(width).fill(-1e9);
    for (let k = 0; k < count; k++) {
      const now = new Float32Array(width);
      for (let i = 0; i < width; i++) {
        const at = (forward ? k : count - 1 - k) * major + i * minor;
        const place = clamp(i + aside, 0, width - 1.001);
        const first = Math.floor(place);
        const shade = before[first] + (place - first) * (before[first + 1] - before[first]) - drop;
        share[at] = clamp(0.9 + (height[at] - shade) / (0.35 * drop + 1), 0, 1);
        now[i] = Math.max(shade, height[at]);
      }
      before = now;
    }
    return share;
  }
}

// A tile's vertices, (column, row, 1 at the foot of its skirt) each, and its triangles.
function tileMesh() {
  const [corners, triangles] = [[], []];
  const quad = (a, b, c, d) => triangles.push(a, b, c, a, c, d);
  const at = (column, row) => row * (TILE + 1) + column;
  for (let row = 0; row <= TILE; row++)
    for (let column = 0; column <= TILE; column++) {
      corners.push(column, row, 0);
      if (row < TILE && column < TILE) quad(at(column, row), at(column, row + 1), at(column + 1, row + 1), at(column + 1, row));
    }
  for (const edge of [(k) => [k, 0], (k) => [TILE, k], (k) => [TILE - k, TILE], (k) => [0, TILE - k]])
    for (let k = 0; k <= TILE; k++) {
      const foot = corners.length / 3;
      corners.push(...edge(k), 1);
      if (k < TILE) quad(at(...edge(k)), at(...edge(k + 1)), foot + 1, foot);
    }
  return [new Float32Array(corners), new Uint16Array(triangles)];
}
