#include "anigen/models/structured_latent_runs.h"

#include "anigen/models/trained_model.h"

namespace anigen::models {

StructuredLatentEncoder load_structured_latent_encoder(const RunModel& found, torch::Device device) {
  return load_trained<StructuredLatentEncoder, StructuredLatentEncoderOptions>(found, device);
}

StructuredLatentDecoder load_structured_latent_decoder(const RunModel& found, torch::Device device) {
  return load_trained<StructuredLatentDecoder, StructuredLatentDecoderOptions>(found, device);
}

}  // namespace anigen::models
