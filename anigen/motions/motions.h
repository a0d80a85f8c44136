#pragma once
/// Any motion onto any rig: limbs of a body, gaits with feet by inverse kinematics, gestures, clips of other files
/// transferred limb to limb, feet that stay where they stand. animate_files.h does it for files.
#include "anigen/motions/animate_files.h"
#include "anigen/motions/built_in.h"
#include "anigen/motions/contact.h"
#include "anigen/motions/figure.h"
#include "anigen/motions/gaits.h"
#include "anigen/motions/gestures.h"
#include "anigen/motions/limbs.h"
#include "anigen/motions/pictures.h"
#include "anigen/motions/poser.h"
#include "anigen/motions/retargeted.h"
