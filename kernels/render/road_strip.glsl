// A straight piece of a road on the ground, as an instance: road_strip.vert.glsl draws a box about it, and
// road_strip.frag.glsl paints the ground that is drawn in the box, at any level of detail.
uniform float lift; // m, by which the drawn ground is off at most, per m of distance

const float REACH = 0.7;   // m up and down that the drawn ground may be off the road's surface, and more with the distance
const float OVERLAP = 3.0; // m that a road continues under a bridge or into a tunnel

float strip_reach(float distance) { return REACH + 0.3 * lift * distance; }

// Kinds of ends.
const float CUT = 0.0, ROUND = 1.0, LONGER = 2.0;
