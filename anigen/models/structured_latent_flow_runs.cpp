#include "anigen/models/structured_latent_flow_runs.h"

#include "anigen/models/trained_model.h"

namespace anigen::models {

StructuredLatentFlow load_structured_latent_flow(const RunModel& found, torch::Device device) {
  return load_trained<StructuredLatentFlow, StructuredLatentFlowOptions>(found, device);
}

}  // namespace anigen::models
