#pragma once
/// Rigged files become a dataset on disk: import, cleaning, posed variants, voxels, views, features. dataset.h is the
/// entry; workers.h, manifest.h and merge.h share the work among processes and resume it.
#include "anigen/prepare/cleaning.h"
#include "anigen/prepare/dataset.h"
#include "anigen/prepare/dataset_card.h"
#include "anigen/prepare/manifest.h"
#include "anigen/prepare/merge.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/pose_augmentation.h"
#include "anigen/prepare/poses.h"
#include "anigen/prepare/prepare_source.h"
#include "anigen/prepare/run.h"
#include "anigen/prepare/sources.h"
#include "anigen/prepare/steps.h"
#include "anigen/prepare/workers.h"
