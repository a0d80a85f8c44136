#pragma once
/// Stages 3 and 5: latents on voxels of shape and skeleton, their decoder to the three fields, and the flow over
/// them.
#include "anigen/structured_latent/decoder.h"
#include "anigen/structured_latent/encoder.h"
#include "anigen/structured_latent/flow.h"
#include "anigen/structured_latent/options.h"
#include "anigen/structured_latent/rig_loss.h"
#include "anigen/structured_latent/sampling.h"
#include "anigen/structured_latent/torso.h"
