#pragma once
/// The skin field (paper 3.3.1): SkinAE, which encodes skin weights as features of vertices and joints.
#include "anigen/skin_field/loss.h"
#include "anigen/skin_field/sampling.h"
#include "anigen/skin_field/skin_autoencoder.h"
