#pragma once
#include "anigen/motions/built_in.h"

namespace anigen::motions {

/// Poses of one moment of motions that are not gaits. @param cycle in [0, 1]: 0 and 1 are the same pose in those that
/// loop
void pose_idle(Poser& poser, double cycle);
void pose_jump(Poser& poser, double cycle);
void pose_swim(Poser& poser, double cycle);
void pose_slither(Poser& poser, double cycle);
void pose_fly(Poser& poser, double cycle);
void pose_wave(Poser& poser, double cycle);
void pose_wag(Poser& poser, double cycle);
void pose_look(Poser& poser, double cycle);
void pose_nod(Poser& poser, double cycle);
void pose_dance(Poser& poser, double cycle);
void pose_spin(Poser& poser, double cycle);
void pose_sway(Poser& poser, double cycle);

/// Way of a snake in a cycle of pose_slither(), at which its body follows its own track.
double slither_stride(const Body& body);

/// True while the feet of a jump stand.
bool jump_stands(double cycle);

}  // namespace anigen::motions
