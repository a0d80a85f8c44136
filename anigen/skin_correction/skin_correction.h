#pragma once
/// Skin weights as a learned correction of classical ones: the network, and weights of whole meshes.
#include "anigen/skin_correction/network.h"
#include "anigen/skin_correction/weights.h"
