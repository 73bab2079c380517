"use strict";
// Shaders. Sky, air, tone curve, leaves and water are the renderer's own, which scene.js brings along; as there, positions
// are metres from the eye, x east, y north, z up, and `world` is metres from the grid's south-west corner.

function shaderSources({ kernels, view, materials, weather }, software) {
  const cover = { clear: 0, cirrus: 0.15, stratus: 1 }[weather.sky] ?? weather.clouds;
  const floats = (...values) => values.map((value) => value.toExponential(8)).join(", ");
  const head = `#version 300 es
    precision highp float; precision highp int; precision highp sampler2D; precision highp sampler2DArray; precision highp sampler2DShadow;
    ${kernels.frame}
    #define clock near_map.x  // s: the maps of the frame that the page lacks carry this,
    #define lattice far_map   // metres between the heights, metres of the grid,
    #define rays mat3(from_clip) // and right, up and ahead to the borders of the picture
    uniform sampler2D heights; // m, row 0 is the north edge; of the finest level that has arrived
    vec2 from_north(vec2 world) { return vec2(world.x, lattice.w - world.y); }
    vec2 texel_at(vec2 world) { return clamp((from_north(world) / lattice.xy + 0.5) / vec2(textureSize(heights, 0)), 0.0, 1.0); }`;
  const light = `${head}
    ${kernels.tone}
    uniform sampler2D noise;   // four smooth channels, 0.5 + a quarter of values of a deviation of about 0.5
    uniform sampler2D surface; // of the ground: normal east and north, visible share of the sun
    uniform sampler2D cover;   // share of the ground under plants
    uniform sampler2DShadow shadows; // of plants around the eye
    vec4 noise_at(vec2 at) { return texture(noise, at) * 4.0 - 2.0; }
    float cover_at(vec2 world) { return texture(cover, from_north(world) / lattice.zw).r; }
    vec4 developed(vec3 radiance, float opacity, vec2 pixel) {
      return vec4(film(radiance * ${floats(view.exposure)}) + (interleaved_noise(pixel) - 0.5) / 255.0, opacity);
    }
    // Share of the sun that the terrain and plants let through: near plants by their shadows, others by their cover.
    float sun_at(vec3 position, float covered) {
      float sun = texture(surface, texel_at(position.xy + eye.xy)).z;
      vec3 at = (to_shade[0] * vec4(position, 1.0)).xyz * 0.5 + 0.5;
      float near = 1.0 - smoothstep(0.4, 0.5, max(abs(at.x - 0.5), abs(at.y - 0.5)));
      if (near <= 0.0 || sun == 0.0) return sun * (1.0 - 0.8 * covered);
      float lit = 0.0;
      for (int i = 0; i < 4; ++i)
        lit += texture(shadows, vec3(at.xy + vec2((i & 1) * 2 - 1, (i & 2) - 1) / 2700.0, at.z - 0.0008)) / 4.0;
      return sun * mix(1.0 - 0.8 * covered, lit, near);
    }
    vec3 diffuse(vec3 albedo, vec3 n, float sun, float sky) {
      return albedo / PI * (sun_light.rgb * (max(dot(n, to_sun.xyz), 0.0) * sun) + sky_irradiance(n) * sky);
    }
    float cloud_noise(vec2 at) { return dot(noise_at(at).xy, vec2(0.7, 0.3)) + dot(noise_at(at * 3.7).zw, vec2(0.4, 0.3)); }
    // The sky with a flat layer of more or less soft clouds, darker where they are denser towards the sun.
    vec3 cloudy_sky(vec3 direction, float soft) {
      vec3 up = normalize(vec3(direction.xy, max(direction.z, 0.0)));
      vec3 sky = clear_sky(up);
      float amount = ${floats(cover)};
      if (amount == 0.0 || up.z < 0.01) return sky;
      vec2 at = (up.xy / (up.z + 0.03) * 1700.0 + eye.xy + clock * vec2(4.0, 2.0)) / 9000.0;
      float here = cloud_noise(at) - 1.15 + 1.6 * amount, thick = smoothstep(-soft, 0.4 + soft, here);
      float shade = smoothstep(-0.5, 1.1, cloud_noise(at + 0.02 * to_sun.xy) - 1.15 + 1.6 * amount);
      vec3 lit = sun_light.rgb * mix(0.36, 0.08, shade) + sky_irradiance(vec3(0.0, 0.0, 1.0)) * 0.25;
      return mix(sky, lit, 0.95 * thick * smoothstep(0.01, 0.13, up.z));
    }`;

  const fragment = `${light}
    out vec4 shown;
    void show(vec3 radiance, vec3 position, float opacity) {
      shown = developed(through_air(radiance, position), opacity, gl_FragCoord.xy);
    }`;
  const ground = {
    vertex: `${head}
      in vec3 corner; // column and row in its tile; 1 at the foot of its skirt
      in vec3 tile;   // first column and row, texels between vertices
      out vec3 position;
      void main() {
        ivec2 at = min(ivec2(tile.xy + corner.xy * tile.z), textureSize(heights, 0) - 1);
        float height = texelFetch(heights, at, 0).r - corner.z * tile.z * lattice.x;
        position = vec3(from_north(min(vec2(at) * lattice.xy, lattice.zw)), height) - eye.xyz;
        gl_Position = to_clip * vec4(position, 1.0);
      }`,
    fragment: `${fragment}
      uniform sampler2DArray weights; // four materials a layer
      uniform sampler2DArray colours; // of the materials: albedo, height
      uniform sampler2DArray slopes;  // east and north, halved
      uniform sampler2D painted;      // √albedo of roads and land use, their share
      in vec3 position;
      const vec3 SIZES[] = vec3[](${materials.map((each) => `vec3(${floats(each.width, each.coarsest, each.bump)})`)}); // m, coarsest octave
      const mat2 TURN = mat2(0.8, 0.6, -0.6, 0.8);
      vec3 varied(int layer, vec3 colour, vec4 wide, vec4 middle, vec4 small) {
        colour *= 1.0 + 0.13 * middle.w + 0.10 * small.w;
        ${materials.map(({ variations }, k) => (variations.length ? `if (layer == ${k}) { ${variations.join(" ")} }` : "")).join("\n")}
        return colour;
      }
      void main() {
        vec2 world = position.xy + eye.xy, uv = texel_at(world);
        vec3 n = vec3(texture(surface, uv).xy * 2.0 - 1.0, 0.0);
        n.z = sqrt(max(1.0 - dot(n.xy, n.xy), 0.01));
        float pixel = length(position) * trees.z, covered = cover_at(world);
        vec4 wide = noise_at(world / 4096.0), middle = 0.7 * noise_at(world / 512.0 + 0.37), small = 0.7 * noise_at(world / 61.0);
        // Steep ground has its textures from the side that it faces.
        vec2 at = world, side = abs(n.xy) + 0.06 * small.xy;
        if (n.z + 0.05 * small.z < 0.74) at = vec2(side.x > side.y ? world.y : world.x, position.z + eye.z);
        mat2 steps = mat2(dFdx(at), dFdy(at));
        vec3 albedo = vec3(0.0);
        vec2 slope = vec2(0.0);
        vec4 four;
        float total = 1e-3;
        bool detailed = pixel < ${software ? "0.5" : "3.0"};
        for (int i = 0; i < ${materials.length}; ++i) {
          if ((i & 3) == 0) four = textureLod(weights, vec3(uv, i >> 2), 0.0);
          float weight = four[i & 3];
          if (weight < 0.04) continue;
          // Two octaves, turned, of a size that hides that they repeat.
          float octave = clamp(log2(pixel * 200.0 / SIZES[i].x), -1.5, SIZES[i].y + 2.5), part = smoothstep(${software ? "0.49, 0.51" : "0.2, 0.8"}, fract(octave));
          vec4 tint = vec4(0.0);
          vec2 bumps = vec2(0.0);
          for (int k = 0; k < 2; ++k) {
            float share = k == 0 ? 1.0 - part : part, size = SIZES[i].x * exp2(floor(octave) + float(k));
            if (share == 0.0) continue;
            mat2 turn = (int(octave + 2.0) + k & 1) == 0 ? mat2(1.0) : TURN;
            vec3 place = vec3(turn * at / size, i);
            mat2 grad = turn * steps / size;
            tint += share * textureGrad(colours, place, grad[0], grad[1]);
            if (detailed) bumps += share * ((textureGrad(slopes, place, grad[0], grad[1]).xy * 2.0 - 1.0) * turn);
          }
          float share = weight * (0.25 + weight) * (0.15 + tint.a);
          albedo += share * varied(i, tint.rgb, wide, middle, small);
          slope += share * bumps;
          total += share;
        }
        vec4 paint = texture(painted, uv);
        albedo = mix(albedo / total, paint.rgb * paint.rgb, paint.a);
        n = normalize(n - vec3(slope / total * (1.0 - paint.a) * (1.0 - smoothstep(0.3, 3.0, pixel)), 0.0));
        show(diffuse(albedo, n, sun_at(position, covered), 1.0 - 0.6 * covered), position, 1.0);
      }`,
  };
  const meshVertex = (nearer) => `${head}
      in vec3 place, normal, tint;
      out vec3 position, facing, albedo;
      void main() {
        position = place - eye.xyz;
        facing = normal;
        albedo = tint * tint;
        gl_Position = to_clip * vec4(position, 1.0);
        // Drawn over ground that is less far in front of it.
        vec4 close = to_clip * vec4(position * (1.0 - min(${nearer} / length(position), 0.5)), 1.0);
        gl_Position.z = close.z / close.w * gl_Position.w;
      }`;
  const mesh = {
    vertex: meshVertex("0.5 * lattice.x"),
    fragment: `${fragment}
      in vec3 position, facing, albedo;
      void main() {
        vec2 world = position.xy + eye.xy, within = step(vec2(0.0), world) * step(world, lattice.zw);
        vec3 colour = albedo * (1.0 + 0.25 * noise_at(world / 4096.0).x + 0.2 * noise_at(world / 97.0).y);
        float sun = within.x * within.y > 0.0 ? sun_at(position, 0.0) : 1.0;
        show(diffuse(colour, normalize(facing), sun, 1.0), position, 1.0);
      }`,
  };

  const plantHead = `${light}
    in vec3 corner, normal, tint; // of the model, sizes; √albedo
    in vec3 place;                // of the plant, shares of the grid and of the heights
    in vec2 growth;               // scale and turn
    uniform vec4 model;           // size at scale 1, m; lowest height and their range, m; number
    out vec3 position, facing, albedo, clear, glow; // of the air before the plant: transmittance and light
    out float sun;
    void light_plant() {
      glow = through_air(vec3(0.0), position);
      clear = through_air(vec3(1.0), position) - glow;
      sun = sun_at(position + 0.7 * to_sun.xyz, 0.0);
    }
    mat2 turned() {
      float angle = 6.2831853 * growth.y * 255.0 / 256.0, varied = fract(place.x * 7919.0 + place.y * 3571.0);
      mat2 turn = mat2(cos(angle), sin(angle), -sin(angle), cos(angle));
      position = vec3(place.xy * lattice.zw, model.y + place.z * model.z) - eye.xyz;
      facing = vec3(turn * normal.xy, normal.z);
      albedo = tint * tint * mix(vec3(0.75, 0.82, 0.85), vec3(1.1, 1.02, 0.95), varied);
      return turn;
    }`;
  const plantVertex = (matrix, lit) => `${plantHead}
    out vec3 leaf; // place in the triangle, across -1 … 1 and along 0 … 1; 1 for leaves, 0 for bark
    void main() {
      mat2 turn = turned();
      leaf = vec3(vec2[](vec2(-1.0, 0.0), vec2(1.0, 0.0), vec2(0.0, 1.0))[gl_VertexID % 3], step(1.1 * tint.r, tint.g));
      position += model.x * growth.x * vec3(turn * corner.xy, corner.z);
      ${lit}
      gl_Position = ${matrix} * vec4(position, 1.0);
    }`;
  const leaves = `${light}
    ${kernels.tree_light}
    in vec3 position, albedo, clear, glow;
    in float sun;
    out vec4 shown;
    void show_leaves(vec3 tint, vec3 n) {
      vec3 lit = leaf_light(albedo * tint, normalize(n), 1.0, normalize(position), sun, 0.85, 0.8);
      shown = developed(lit * clear + glow, 1.0, gl_FragCoord.xy);
    }`;
  const plants = {
    vertex: plantVertex("to_clip", "light_plant();"),
    fragment: `${leaves}
      in vec3 facing, leaf;
      void main() {
        // Cut into sprays.
        if (abs(leaf.x) > (1.0 - leaf.y) * (0.4 + 0.6 * abs(fract(leaf.y * 4.0) * 2.0 - 1.0)) && leaf.z > 0.5) discard;
        show_leaves(vec3(1.0), facing);
      }`,
  };
  const shadow = { vertex: plantVertex("to_shade[0]", ""), fragment: "#version 300 es\nvoid main() {}" };
  // Distant plants: pictures that face the eye, 1.3 sizes wide and high, of a model each in five columns.
  const impostors = {
    vertex: `${plantHead}
      out vec2 at;
      out mat3 axes;
      void main() {
        turned();
        light_plant();
        vec3 ahead = normalize(position), right = normalize(vec3(ahead.y, -ahead.x, 1e-5));
        vec3 up = normalize(mix(vec3(0.0, 0.0, 1.0), cross(right, ahead), 0.6));
        position += 1.3 * model.x * growth.x * (right * (corner.x - 0.5) + up * (corner.y - 0.09));
        float mirrored = growth.y > 0.5 ? -1.0 : 1.0;
        at = (vec2(mod(model.w, 5.0), floor(model.w / 5.0 + 0.01)) + vec2(0.5 + mirrored * (corner.x - 0.5), corner.y)) / 5.0;
        axes = mat3(mirrored * right, up, -ahead);
        gl_Position = to_clip * vec4(position, 1.0);
      }`,
    fragment: `${leaves}
      uniform sampler2D pictures, normals;
      in vec2 at;
      in mat3 axes;
      void main() {
        vec4 seen = texture(pictures, at);
        float texels = length(fwidth(at)) * float(textureSize(pictures, 0).x);
        if (seen.a * (1.0 + 0.35 * max(log2(texels), 0.0)) < 0.45) discard;
        show_leaves(seen.rgb * seen.rgb, axes * (texture(normals, at).xyz * 2.0 - 1.0));
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
      void main() { seen = vec4(root, 1.0); turned = vec4(facing, 1.0); }`,
  };

  const water = {
    vertex: meshVertex("0.2"),
    fragment: `${fragment}
      ${kernels.water_optics}
      in vec3 position;
      vec2 wave(vec2 at, vec2 drift) { return noise_at(at + clock * drift).xy + noise_at(mat2(0.8, 0.6, -0.6, 0.8) * at * 1.37 - clock * drift).zw; }
      void main() {
        vec2 world = position.xy + eye.xy;
        float away = length(position), pixel = away * trees.z, depth = 30.0;
        if (clamp(world, vec2(0.0), lattice.zw) == world) depth = position.z + eye.z - texture(heights, texel_at(world)).r;
        float gust = 0.5 + 0.5 * smoothstep(-0.6, 0.6, noise_at(world / 1900.0 + 0.002 * clock).x);
        vec2 slope = gust * (0.003 * wave(world / 230.0, vec2(0.004, 0.003)) + 0.006 * wave(world / 53.0, vec2(0.012, -0.009)));
        slope += gust * 0.015 * wave(world / 13.0, vec2(-0.03, 0.04));
        float spread = 0.02 + 0.05 * gust * smoothstep(0.01, 1.0, pixel);
        vec3 to_eye = -position / away, n = normalize(vec3(-slope, 1.0)), up = vec3(0.0, 0.0, 1.0);
        vec3 back = reflect(-to_eye, n);
        back.z = max(abs(back.z), 0.01);
        // How much of what is mirrored is ground and plants.
        float hidden = 0.0, along = 10.0;
        for (int i = 0; i < 10; ++i, along *= 1.7) {
          vec3 there = position + back * along;
          float top = texture(heights, texel_at(there.xy + eye.xy)).r + 11.0 * cover_at(there.xy + eye.xy);
          hidden = max(hidden, smoothstep(0.0, 0.05 * along, top - there.z - eye.z));
        }
        vec3 light = sun_light.rgb * max(to_sun.z, 0.0) + sky_irradiance(up), shore = vec3(0.035, 0.045, 0.02) / PI * light;
        float sun = texture(surface, texel_at(world)).z, share = mirrored_share(max(dot(n, to_eye), 0.02), spread);
        vec3 glint = sun_light.rgb * (sun * min(glitter(to_eye, to_sun.xyz, slope, spread + 0.02), 10.0));
        float opaque = 1.0 - exp(-0.8 * max(depth, 0.0) / max(to_eye.z, 0.25)), opacity = share + opaque * (1.0 - share);
        vec3 body = mix(vec3(0.02, 0.07, 0.065), vec3(0.006, 0.022, 0.03), opaque) / PI * light;
        vec3 above = normalize(back + vec3(0.0, 0.0, 0.12)); // waves blur the clouds
        vec3 mirrored = mix(mix(clear_sky(back), cloudy_sky(above, 1.6), 0.45), shore, hidden);
        vec3 radiance = mix(body, mirrored, share / max(opacity, 1e-3)) + glint;
        show(radiance, position, opacity * smoothstep(-0.4, 0.1, depth));
      }`,
  };
  const sky = {
    vertex: `${head}
      out vec3 ray;
      void main() {
        vec2 at = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2) * 2.0 - 1.0;
        ray = rays * vec3(at, 1.0);
        gl_Position = vec4(at, 1.0, 1.0);
      }`,
    fragment: `${fragment}
      in vec3 ray;
      void main() {
        vec3 direction = normalize(ray), disc = sun_light.rgb * 60.0;
        vec3 radiance = direction.z > 0.0 ? cloudy_sky(direction, 0.1) : air_light(direction);
        float off = distance(direction, to_sun.xyz) / 0.00466;
        show(radiance + disc * (1.0 - smoothstep(0.8, 1.15, off)) * step(0.0, direction.z), vec3(0.0, 0.0, 1e-3), 1.0);
      }`,
  };
  return { ground, mesh, plants, shadow, impostors, picture, water, sky };
}
