#pragma once
/// Networks that look at images: DINOv2, DSINE, LPIPS, a small patch encoder, a picture estimator, a matting
/// network; features on voxels; image conditions.
#include "anigen/vision/condition.h"
#include "anigen/vision/dinov2.h"
#include "anigen/vision/dsine.h"
#include "anigen/vision/dsine_network.h"
#include "anigen/vision/lpips.h"
#include "anigen/vision/matting.h"
#include "anigen/vision/patch_encoder.h"
#include "anigen/vision/picture_estimator.h"
#include "anigen/vision/surface_features.h"
#include "anigen/vision/unet.h"
#include "anigen/vision/voxel_features.h"
