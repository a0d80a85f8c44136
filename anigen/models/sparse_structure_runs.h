#pragma once
#include "anigen/models/run_model.h"
#include "anigen/models/sparse_structure_decoder.h"
#include "anigen/models/sparse_structure_encoder.h"
#include "anigen/models/sparse_structure_flow.h"

namespace anigen::models {

/// Class names of the two models of stage 2 in configs.
inline constexpr const char* kSparseStructureEncoderClass = "AniGenSparseStructureEncoder";
inline constexpr const char* kSparseStructureDecoderClass = "AniGenSparseStructureDecoder";

/// A trained model of stage 2 for use: weights loaded strictly, in fp32, evaluation mode, nothing asks for gradients.
/// @param found by find_run_model() @throws InputError when arguments or weights do not fit
SparseStructureEncoder load_sparse_structure_encoder(const RunModel& found, torch::Device device);
SparseStructureDecoder load_sparse_structure_decoder(const RunModel& found, torch::Device device);

/// The flow model of stage 4 in configs.
inline constexpr const char* kSparseStructureFlowClass = "AniGenSparseStructureFlowModel";

/// The same for the flow of stage 4.
SparseStructureFlow load_sparse_structure_flow(const RunModel& found, torch::Device device);

}  // namespace anigen::models
