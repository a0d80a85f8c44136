#pragma once
/// Stages 2 and 4: voxels of shape and skeleton as a dense latent, and the flow that generates it from an image.
#include "anigen/sparse_structure/autoencoder.h"
#include "anigen/sparse_structure/flow.h"
#include "anigen/sparse_structure/layers.h"
#include "anigen/sparse_structure/options.h"
#include "anigen/sparse_structure/voxel_metrics.h"
#include "anigen/sparse_structure/voxel_picture.h"
