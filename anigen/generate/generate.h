#pragma once
/// Whole jobs with trained models: image to rigged GLB, latents of a dataset, retrieval, learned rigging of meshes.
/// Never includes train/: the link line enforces it.
#include "anigen/generate/anymate_rigger.h"
#include "anigen/generate/assemble.h"
#include "anigen/generate/asset_generator.h"
#include "anigen/generate/encode.h"
#include "anigen/generate/encode_report.h"
#include "anigen/generate/evaluate.h"
#include "anigen/generate/finishing.h"
#include "anigen/generate/generate_assets.h"
#include "anigen/generate/latent_records.h"
#include "anigen/generate/learned_rigging.h"
#include "anigen/generate/picture_input.h"
#include "anigen/generate/preprocess.h"
#include "anigen/generate/retrieve.h"
#include "anigen/generate/rignet_rigger.h"
#include "anigen/generate/run_weights.h"
#include "anigen/generate/stage_generators.h"
