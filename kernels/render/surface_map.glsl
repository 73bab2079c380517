// Map of the drawn terrain: morphed tiles deviate from the true terrain by up to their tolerance, and plants and rocks
// are placed on what is drawn. Each texture has two squares around the eye: near (west) and far (east), wider and
// coarser. Positions are relative to the eye, m. Depends on its uniforms only. Oracle: tests/render/test_shaders.py.
//   MATERIALS 1: one lookup per query, so the squares meet at an edge
#ifndef MATERIALS
#define MATERIALS 2
#endif

uniform sampler2D surface; // xy: normal; z: height above the square's origin, m; w: 1; all zero where nothing is drawn
uniform sampler2D surface_weights[WEIGHT_WORDS]; // of the materials
uniform vec4 surface_near; // xy: south-west corner, m; z: 1 / width, 1/m; w: height origin, m
uniform vec4 surface_far;

const float SURFACE_EDGE = 0.01; // unused border of a square, in widths: more than a texel
const float SURFACE_FADE = 0.08; // width of the cross-fade between the squares, in widths

// Weight of a square at a position in it: 1 inside, 0 from its border on.
float surface_share(vec2 uv)
{
    vec2 room = min(uv, 1.0 - uv);
    return clamp((min(room.x, room.y) - SURFACE_EDGE) / SURFACE_FADE, 0.0, 1.0);
}

// Texture coordinates in both squares, and their weights.
struct SurfacePlace {
    vec2 near_uv, far_uv; // in the textures
    float near_share, far_share;
};

SurfacePlace surface_place(vec2 place)
{
    vec2 near_uv = (place - surface_near.xy) * surface_near.z;
    vec2 far_uv = (place - surface_far.xy) * surface_far.z;
    float near_share = surface_share(near_uv);
    float far_share = min(surface_share(far_uv) * 1e6, 1.0);
#if MATERIALS == 1
    near_share = step(0.5, near_share);
#endif
    vec2 half_width = vec2(0.5, 1.0);
    return SurfacePlace(clamp(near_uv, SURFACE_EDGE, 1.0 - SURFACE_EDGE) * half_width,
        clamp(far_uv, SURFACE_EDGE, 1.0 - SURFACE_EDGE) * half_width + vec2(0.5, 0.0), near_share,
        far_share * (1.0 - near_share));
}

vec4 surface_texel(sampler2D map, SurfacePlace at)
{
#if MATERIALS == 1
    bool nearby = at.near_share > at.far_share;
    return textureLod(map, nearby ? at.near_uv : at.far_uv, 0.0) * max(at.near_share, at.far_share);
#else
    return textureLod(map, at.near_uv, 0.0) * at.near_share + textureLod(map, at.far_uv, 0.0) * at.far_share;
#endif
}

// x and y of the normal, height above the eye (m), coverage 0..1; all zero where nothing is drawn.
vec4 drawn_surface(vec2 place)
{
    SurfacePlace at = surface_place(place);
#if MATERIALS == 1
    vec4 texel = surface_texel(surface, at);
    texel.z += texel.w * (at.near_share > at.far_share ? surface_near.w : surface_far.w);
#else
    vec4 near = textureLod(surface, at.near_uv, 0.0) * at.near_share;
    vec4 far = textureLod(surface, at.far_uv, 0.0) * at.far_share;
    vec4 texel = near + far;
    texel.z += near.w * surface_near.w + far.w * surface_far.w;
#endif
    return texel.w > 1e-3 ? vec4(texel.xyz / texel.w, texel.w) : vec4(0.0);
}

// Height above the eye (m) of the drawn terrain at a foot point, or of the foot point itself.
float standing_height(vec3 foot)
{
    vec4 drawn = drawn_surface(foot.xy);
    return drawn.w > 0.0 ? drawn.z : foot.z;
}

// Normal of a result of drawn_surface: up where nothing is drawn.
vec3 drawn_normal(vec4 drawn)
{
    return vec3(drawn.xy, sqrt(max(1.0 - dot(drawn.xy, drawn.xy), 0.0)));
}

// Weights of the materials; zero where nothing is drawn.
void drawn_weights(vec2 place, out vec4 weights[WEIGHT_WORDS])
{
    SurfacePlace at = surface_place(place);
    for (int k = 0; k < WEIGHT_WORDS; ++k) weights[k] = surface_texel(surface_weights[k], at);
}
