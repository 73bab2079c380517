"use strict";
// Shaders of the page. Sky, air, tone curve, leaves and water are the renderer's own sources, which scene.js carries;
// as there, positions are metres from the eye, x east, y north, z up.

function shaderSources(scene) {
  const { frame, tone, tree_light: treeLight, water_optics: waterOptics } = scene.kernels;
  const number = (value) => value.toExponential(8);
  const { clouds, sky: kind } = scene.weather;
  const cover = { clear: 0, cirrus: 0, stratus: 1 }[kind] ?? clouds;

  const shared = `#version 300 es
    precision highp float;
    precision highp int;
    precision highp sampler2D;
    precision highp sampler2DArray;
    precision highp sampler2DShadow;
    ${frame}
    uniform sampler2D heights; // m, of the finest level at hand; row 0 is the north edge
    // The frame's maps that the page has not carry the time, s, and metres between texels and of the grid.
    #define clock near_map.x
    #define lattice far_map
    vec2 texel_at(vec2 world) { return (vec2(world.x, lattice.w - world.y) / lattice.xy + 0.5) / vec2(textureSize(heights, 0)); }
  `;

  const light = `${shared}
    ${tone}
    uniform sampler2D noise;   // smooth, four channels
    uniform sampler2D surface; // of the ground: normal east and north, visible share of the sun and of the sky
    uniform sampler2D cover;   // share of the ground under plants
    uniform sampler2DShadow shadows;
    out vec4 colour;

    void show(vec3 radiance, float alpha) {
      colour = vec4(film(radiance * ${number(scene.exposure)}) + (interleaved_noise(gl_FragCoord.xy) - 0.5) / 255.0, alpha);
    }

    // Sunlight that plants nearby let through, and further away their share of the ground.
    float plant_shade(vec3 position, float covered) {
      vec3 at = (to_shade[0] * vec4(position, 1.0)).xyz * 0.5 + 0.5;
      float inside = 1.0 - smoothstep(0.42, 0.5, max(abs(at.x - 0.5), abs(at.y - 0.5)));
      float far = 1.0 - 0.85 * covered;
      if (inside <= 0.0) return far;
      vec2 texel = 0.75 / vec2(textureSize(shadows, 0));
      float near = 0.0;
      for (int i = 0; i < 4; ++i)
        near += texture(shadows, vec3(at.xy + texel * vec2((i & 1) * 2 - 1, (i & 2) - 1), at.z - 0.0006));
      return mix(far, 0.25 * near, inside);
    }

    float cloud_noise(vec2 at) {
      float n = texture(noise, at).x * 0.5 + texture(noise, at * 2.3 + 0.31).y * 0.27;
      return n + texture(noise, at * 6.1 + 0.7).z * 0.15 + texture(noise, at * 17.0).w * 0.08;
    }

    // Sky with a flat layer of clouds, lit by how much denser they are towards the sun.
    vec3 sky_with_clouds(vec3 direction) {
      vec3 up = normalize(vec3(direction.xy, max(direction.z, 0.0)));
      vec3 sky = clear_sky(up);
      const float amount = ${number(cover)};
      if (amount == 0.0 || up.z < 0.012) return sky;
      vec2 at = (up.xy / (up.z + 0.02) * 1700.0 + eye.xy + clock * vec2(4.0, 2.0)) / 21000.0;
      float edge = 0.655 - 0.33 * amount, here = cloud_noise(at);
      float thick = smoothstep(edge, edge + 0.13, here);
      float shade = smoothstep(-0.06, 0.12, cloud_noise(at + 0.014 * to_sun.xy) - edge);
      vec3 lit = sun_light.rgb * mix(0.34, 0.13, shade * thick) + sky_irradiance(vec3(0.0, 0.0, 1.0)) * 0.24;
      return mix(sky, mix(sky, lit, 0.94), thick * smoothstep(0.012, 0.12, up.z));
    }
  `;

  const ground = {
    vertex: `${shared}
      in vec3 corner; // column and row in its tile; 1 at the foot of the skirt
      in vec3 tile;   // first column and row, texels between vertices
      out vec3 position;
      void main() {
        ivec2 at = min(ivec2(tile.xy + corner.xy * tile.z), textureSize(heights, 0) - 1);
        vec2 world = min(vec2(at) * lattice.xy, lattice.zw);
        float skirt = corner.z * tile.z * lattice.x;
        position = vec3(world.x, lattice.w - world.y, texelFetch(heights, at, 0).r - skirt) - eye.xyz;
        gl_Position = to_clip * vec4(position, 1.0);
      }`,
    fragment: `${light}
      uniform sampler2DArray weights;  // four materials a layer
      uniform sampler2DArray colours;  // of the materials: albedo, height
      uniform sampler2DArray slopes;   // east and north, halved
      uniform sampler2D painted;       // √albedo of roads and land use, and its share
      uniform vec4 sizes[${scene.materials.length}]; // width, m; coarsest octave; roughness
      in vec3 position;

      const mat2 TURN = mat2(0.8, 0.6, -0.6, 0.8);

      // One octave of a material: its colour and height, and its slopes.
      void octave(int layer, vec2 at, mat2 grad, float size, bool detailed, inout vec4 tint, inout vec2 slope, float share) {
        vec3 uv = vec3(at / size, layer);
        tint += share * textureGrad(colours, uv, grad[0] / size, grad[1] / size);
        if (detailed) slope += share * (textureGrad(slopes, uv, grad[0] / size, grad[1] / size).xy * 2.0 - 1.0);
      }

      void main() {
        vec2 world = position.xy + eye.xy, uv = texel_at(world);
        vec4 shape = texture(surface, uv);
        vec3 n = vec3(shape.xy * 2.0 - 1.0, 0.0);
        n.z = sqrt(max(1.0 - dot(n.xy, n.xy), 0.01));
        float pixel = length(position) * trees.z, covered = texture(cover, vec2(world.x, lattice.w - world.y) / lattice.zw).r;
        vec4 wide = texture(noise, world / 2900.0), middle = texture(noise, world / 370.0), small = texture(noise, world / 47.0);
        // Steep ground has its texture from the side, along whichever axis it faces.
        bool steep = n.z + 0.12 * (small.x - 0.5) < 0.72;
        vec2 at = !steep ? world : abs(n.x) > abs(n.y) + 0.2 * (middle.y - 0.5) ? vec2(world.y, position.z + eye.z) : vec2(world.x, position.z + eye.z);
        at += 0.6 * (small.zw - 0.5);
        mat2 grad = mat2(dFdx(at), dFdy(at));
        vec3 albedo = vec3(0.0);
        vec2 slope = vec2(0.0);
        bool detailed = pixel < 4.0;
        float total = 0.0;
        vec4 four;
        for (int i = 0; i < ${scene.materials.length}; ++i) {
          if ((i & 3) == 0) four = textureLod(weights, vec3(uv, i >> 2), 0.0);
          float weight = four[i & 3];
          if (weight < 0.04) continue;
          float fine = clamp(log2(pixel * 300.0 / sizes[i].x), 0.0, sizes[i].y + 2.0), whole = floor(fine), part = smoothstep(0.4, 0.6, fine - whole);
          float size = sizes[i].x * exp2(whole);
          vec4 tint = vec4(0.0);
          vec2 bumps = vec2(0.0);
          if (part < 1.0) octave(i, at, grad, size, detailed, tint, bumps, 1.0 - part);
          if (part > 0.0) octave(i, TURN * at, mat2(TURN * grad[0], TURN * grad[1]), 2.0 * size, detailed, tint, bumps, part);
          float share = weight * (0.25 + weight) * (0.15 + tint.a);
          albedo += share * tint.rgb;
          slope += share * bumps;
          total += share;
        }
        total = max(total, 1e-3);
        albedo *= (0.8 + 0.28 * wide.x + 0.22 * middle.z + 0.16 * (small.y - 0.2)) / total;
        albedo = mix(albedo, albedo * vec3(1.16, 1.03, 0.8), smoothstep(0.45, 0.7, wide.y) * 0.6);
        vec4 paint = texture(painted, uv);
        albedo = mix(albedo, paint.rgb * paint.rgb, paint.a);
        slope *= 1.0 - smoothstep(0.2, 4.0, pixel);
        n = normalize(n - vec3(slope / total, 0.0));
        float facing = max(dot(n, to_sun.xyz), 0.0);
        float sun = shape.z * plant_shade(position, covered), sky = shape.w * (1.0 - 0.55 * covered);
        vec3 lit = albedo / PI * (sun_light.rgb * (facing * sun) + sky_irradiance(n) * sky);
        show(through_air(lit, position), 1.0);
      }`,
  };

  const surroundings = {
    vertex: `${shared}
      in vec3 place, normal, tint;
      out vec3 position, facing, albedo;
      void main() {
        position = place - eye.xyz;
        facing = normal;
        albedo = pow(tint, vec3(2.2));
        gl_Position = to_clip * vec4(position, 1.0);
      }`,
    fragment: `${light}
      in vec3 position, facing, albedo;
      void main() {
        vec3 n = normalize(facing);
        vec2 world = position.xy + eye.xy;
        float varied = 0.75 + 0.3 * texture(noise, world / 2900.0).x + 0.3 * texture(noise, world / 370.0).z;
        vec3 lit = albedo * varied / PI * (sun_light.rgb * max(dot(n, to_sun.xyz), 0.0) + sky_irradiance(n));
        show(through_air(lit, position), 1.0);
      }`,
  };

  const built = {
    vertex: `${shared}
      in vec3 place;
      in float material;
      uniform vec3 palette[${Math.max(scene.colours.length, 1)}];
      out vec3 position;
      flat out vec3 albedo;
      void main() {
        position = place - eye.xyz;
        albedo = palette[int(material)];
        gl_Position = to_clip * vec4(position, 1.0);
        gl_Position.z -= 2e-5 * gl_Position.w;
      }`,
    fragment: `${light}
      in vec3 position;
      flat in vec3 albedo;
      void main() {
        vec3 n = normalize(cross(dFdx(position), dFdy(position)));
        vec2 world = position.xy + eye.xy;
        float grain = 0.8 + 0.4 * texture(noise, world / 3.1).x * texture(noise, world / 41.0).y * 2.0;
        float sun = plant_shade(position, 0.0) * texture(surface, texel_at(world)).z;
        vec3 lit = albedo * grain / PI * (sun_light.rgb * max(dot(n, to_sun.xyz), 0.0) * sun + sky_irradiance(n));
        show(through_air(lit, position), 1.0);
      }`,
  };

  const plantVertex = `${shared}
    in vec3 corner, normal, tint; // of the model: plant sizes; √albedo
    in vec3 place;                // of the plant, shares of the grid and of the heights
    in vec2 growth;               // scale and turn
    uniform vec3 growing;         // m of the model's size at scale 1; lowest height and their range, m
    out vec3 position, facing, albedo;
    vec3 foot() { return vec3(place.xy * lattice.zw, growing.y + place.z * growing.z) - eye.xyz; }
    float chance() { return fract(place.x * 7919.0 + place.y * 3571.0); }
  `;
  const turned = `
    float angle = 6.2831853 * growth.y * (255.0 / 256.0);
    mat2 turn = mat2(cos(angle), sin(angle), -sin(angle), cos(angle));
    position = foot() + growing.x * growth.x * vec3(turn * corner.xy, corner.z);`;
  const plants = {
    vertex: `${plantVertex}
      void main() {
        ${turned}
        facing = vec3(turn * normal.xy, normal.z);
        albedo = tint * tint * mix(vec3(0.85, 0.9, 0.9), vec3(1.2, 1.1, 1.0), chance());
        gl_Position = to_clip * vec4(position, 1.0);
      }`,
    fragment: `${light}
      ${treeLight}
      in vec3 position, facing, albedo;
      void main() {
        float sun = plant_shade(position + 0.5 * to_sun.xyz, 0.0) * texture(surface, texel_at(position.xy + eye.xy)).z;
        show(through_air(leaf_light(albedo, normalize(facing), 1.0, normalize(position), sun, 0.9, 0.85), position), 1.0);
      }`,
  };
  const shadow = {
    vertex: `${plantVertex}
      void main() {
        ${turned}
        gl_Position = to_shade[0] * vec4(position, 1.0);
      }`,
    fragment: `#version 300 es
      void main() {}`,
  };

  // Distant plants: pictures that face the eye. A model's picture is 1.3 sizes wide and high.
  const impostors = {
    vertex: `${plantVertex}
      uniform vec4 picture; // corner and size in the atlas
      out vec2 at;
      out mat3 axes;
      void main() {
        vec3 base = foot();
        vec3 ahead = normalize(base), right = normalize(vec3(ahead.y, -ahead.x, 1e-5));
        vec3 up = normalize(mix(vec3(0.0, 0.0, 1.0), cross(right, ahead), 0.6));
        float size = 1.3 * growing.x * growth.x, mirrored = growth.y > 0.5 ? -1.0 : 1.0;
        position = base + size * (right * (corner.x - 0.5) + up * (corner.y - 0.09));
        at = picture.xy + picture.zw * vec2(0.5 + mirrored * (corner.x - 0.5), corner.y);
        axes = mat3(mirrored * right, up, -ahead);
        albedo = mix(vec3(0.85, 0.9, 0.9), vec3(1.2, 1.1, 1.0), chance());
        gl_Position = to_clip * vec4(position, 1.0);
      }`,
    fragment: `${light}
      ${treeLight}
      uniform sampler2D pictures, normals;
      in vec3 position, albedo;
      in vec2 at;
      in mat3 axes;
      void main() {
        vec4 seen = texture(pictures, at);
        float spread = length(fwidth(at)) * float(textureSize(pictures, 0).x);
        if (seen.a * (1.0 + 0.35 * max(log2(spread), 0.0)) < 0.45) discard;
        vec3 n = axes * (texture(normals, at).xyz * 2.0 - 1.0);
        float sun = plant_shade(position + to_sun.xyz, 0.0) * texture(surface, texel_at(position.xy + eye.xy)).z;
        vec3 lit = leaf_light(seen.rgb * seen.rgb * albedo, normalize(n), 1.0, normalize(position), sun, 0.9, 0.8);
        show(through_air(lit, position), 1.0);
      }`,
  };
  const picture = {
    vertex: `#version 300 es
      in vec3 corner, normal, tint;
      out vec3 facing, root;
      void main() {
        facing = vec3(normal.x, normal.z, -normal.y) * 0.5 + 0.5;
        root = tint;
        gl_Position = vec4(corner.x / 0.65, (corner.z / 1.3 + 0.09) * 2.0 - 1.0, corner.y * 0.9, 1.0);
      }`,
    fragment: `#version 300 es
      precision highp float;
      in vec3 facing, root;
      layout(location = 0) out vec4 seen;
      layout(location = 1) out vec4 turned;
      void main() {
        seen = vec4(root, 1.0);
        turned = vec4(facing, 1.0);
      }`,
  };

  const water = {
    vertex: `${shared}
      in vec3 place;
      out vec3 position;
      void main() {
        position = place - eye.xyz;
        gl_Position = to_clip * vec4(position, 1.0);
      }`,
    fragment: `${light}
      ${waterOptics}
      in vec3 position;

      vec2 wave(vec2 at, vec2 drift) {
        vec4 a = texture(noise, (at + clock * drift) / 1.0), b = texture(noise, (at.yx * 1.37 - clock * drift) / 1.0);
        return vec2(a.x - a.y, b.z - b.w);
      }

      void main() {
        vec2 world = position.xy + eye.xy;
        float away = length(position), pixel = away * trees.z;
        float bed = texture(heights, clamp(texel_at(world), 0.0, 1.0)).r, depth = position.z + eye.z - bed;
        float calm = 0.35 + 0.65 * smoothstep(0.3, 0.7, texture(noise, world / 900.0 + 0.01 * clock).x);
        vec2 slope = calm * (0.06 * wave(world / 170.0, vec2(0.006, 0.004)) + 0.07 * wave(world / 41.0, vec2(0.012, -0.009)) + 0.06 * wave(world / 11.0, vec2(-0.03, 0.04)));
        float spread = 0.02 + 0.03 * calm * smoothstep(0.02, 2.0, pixel);
        vec3 to_eye = -position / away, n = normalize(vec3(-slope, 1.0));
        vec3 back = reflect(-to_eye, n);
        back.z = max(abs(back.z), 0.01);
        // What rises above the mirrored ray, on the ground that there is.
        float hidden = 0.0, along = 12.0;
        for (int i = 0; i < 9; ++i) {
          vec3 there = position + back * along;
          float over = texture(heights, clamp(texel_at(there.xy + eye.xy), 0.0, 1.0)).r + 9.0 * texture(cover, (vec2(there.x, -there.y) + vec2(eye.x, lattice.w - eye.y)) / lattice.zw).r;
          hidden = max(hidden, smoothstep(0.0, 0.06 * along, over - there.z - eye.z));
          along *= 1.75;
        }
        vec3 shore = vec3(0.055, 0.07, 0.035) / PI * (0.45 * sun_light.rgb * to_sun.z + sky_irradiance(vec3(0.0, 0.0, 1.0)));
        vec3 mirrored = mix(sky_with_clouds(back), shore, hidden);
        float lit = texture(surface, clamp(texel_at(world), 0.0, 1.0)).z;
        float share = mirrored_share(max(dot(n, to_eye), 0.02), spread);
        vec3 glint = sun_light.rgb * min(glitter(to_eye, to_sun.xyz, slope, spread + 0.02), 10.0) * lit;
        vec3 light = sun_light.rgb * max(to_sun.z, 0.0) * lit + sky_irradiance(vec3(0.0, 0.0, 1.0));
        vec3 body = vec3(0.006, 0.022, 0.027) * light / PI;
        float opaque = 1.0 - exp(-max(depth, 0.0) * 0.75 / max(to_eye.z, 0.25));
        vec3 radiance = mix(body, mirrored, share / max(share + opaque * (1.0 - share), 1e-3)) + glint;
        float edge = smoothstep(-0.4, 0.1, depth);
        show(through_air(radiance, position), edge * (share + opaque * (1.0 - share)));
      }`,
  };

  const sky = {
    vertex: `#version 300 es
      uniform mat3 rays; // right, up and ahead
      out vec3 ray;
      void main() {
        vec2 at = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2) * 2.0 - 1.0;
        ray = rays * vec3(at, 1.0);
        gl_Position = vec4(at, 1.0, 1.0);
      }`,
    fragment: `${light}
      in vec3 ray;
      void main() {
        vec3 direction = normalize(ray);
        vec3 radiance = direction.z > 0.0 ? sky_with_clouds(direction) : air_light(direction);
        float off = length(cross(direction, to_sun.xyz)) / 0.00466;
        if (dot(direction, to_sun.xyz) > 0.0) radiance += sun_light.rgb * 60.0 * (1.0 - smoothstep(0.8, 1.15, off)) * step(0.0, direction.z);
        show(radiance, 1.0);
      }`,
  };
  return { ground, surroundings, built, plants, shadow, impostors, picture, water, sky };
}
