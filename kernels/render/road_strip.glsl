// A straight piece of a road on the ground, as an instance: road_strip.vert.glsl draws a box about it, and
// road_strip.frag.glsl paints the ground that is drawn in the box, at any level of detail.
const float REACH = 1.0;         // m up and down that the drawn ground may be off the road's surface, ...
const float REACH_RATE = 0.03;   // ... and more with the distance
const float OVERLAP = 3.0;       // m that a road continues under a bridge or into a tunnel

float strip_reach(float distance) { return REACH + REACH_RATE * distance; }

// Kinds of ends.
const float CUT = 0.0, ROUND = 1.0, LONGER = 2.0;
