#include "anigen/models/sparse_structure_runs.h"

#include "anigen/models/trained_model.h"

namespace anigen::models {

SparseStructureEncoder load_sparse_structure_encoder(const RunModel& found, torch::Device device) {
  return load_trained<SparseStructureEncoder, SparseStructureEncoderOptions>(found, device);
}

SparseStructureDecoder load_sparse_structure_decoder(const RunModel& found, torch::Device device) {
  return load_trained<SparseStructureDecoder, SparseStructureDecoderOptions>(found, device);
}

SparseStructureFlow load_sparse_structure_flow(const RunModel& found, torch::Device device) {
  return load_trained<SparseStructureFlow, SparseStructureFlowOptions>(found, device);
}

}  // namespace anigen::models
