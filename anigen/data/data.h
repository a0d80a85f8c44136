#pragma once
/// Datasets on disk become batches of tensors: one class per dataset name of the published configs (datasets.h).
#include "anigen/data/augment.h"
#include "anigen/data/backgrounds.h"
#include "anigen/data/batches.h"
#include "anigen/data/datasets.h"
#include "anigen/data/latent_files.h"
#include "anigen/data/matting_dataset.h"
#include "anigen/data/metadata.h"
#include "anigen/data/picture_dataset.h"
#include "anigen/data/rigged_item.h"
#include "anigen/data/skin_dataset.h"
#include "anigen/data/view_files.h"
#include "anigen/data/voxel_files.h"
