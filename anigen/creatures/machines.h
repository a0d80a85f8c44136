#pragma once
#include "anigen/creatures/body.h"

namespace anigen::creatures {

// Each fills an empty body with the joints, shapes, paints, swings and bends of one random member of a family.
void build_biped(Body& body);
void build_quadruped(Body& body);
void build_bird(Body& body);
void build_fish(Body& body);
void build_snake(Body& body);
void build_spider(Body& body);
void build_insect(Body& body);
void build_dragon(Body& body);
void build_plant(Body& body);
void build_tree(Body& body);
void build_robot_arm(Body& body);
void build_lamp(Body& body);
void build_crab(Body& body);
void build_octopus(Body& body);
void build_hand(Body& body);

}  // namespace anigen::creatures
