#include "anigen/models/structured_latent_runs.h"

#include <string>

#include "anigen/core/error.h"
#include "anigen/models/trained_model.h"

namespace anigen::models {

StructuredLatentEncoder load_structured_latent_encoder(const RunModel& found, torch::Device device) {
  return load_trained<StructuredLatentEncoder, StructuredLatentEncoderOptions>(found, device);
}

StructuredLatentDecoder load_structured_latent_decoder(const RunModel& found, torch::Device device) {
  return load_trained<StructuredLatentDecoder, StructuredLatentDecoderOptions>(found, device);
}

StructuredLatentVariant variant_of_run(const RunModel& decoder) {
  const auto options =
      StructuredLatentDecoderOptions::from_json(decoder.args, decoder.config.string(), decoder.pointer);
  return StructuredLatentVariant::of_run(decoder.run, options, decoder.config.string());
}

StructuredLatentDecoder load_rig_decoder(const RunModel& found, torch::Device device,
                                         const geometry::MeanShiftOptions& grouping) {
  const StructuredLatentVariant variant = variant_of_run(found);
  if (variant.geometry_only) {
    throw InputError(found.config.string(), "/trainer/args/geometry_only",
                     "this run trained the shape alone: its skeletons and weights mean nothing");
  }
  StructuredLatentDecoder decoder = load_structured_latent_decoder(found, device);
  const std::string strategy = decoder->options().grouping_strategy;
  decoder->group_with([confidence = variant.confidence, strategy, grouping](const fields::SkeletonField& field) {
    return fields::group_votes(for_grouping(field, confidence), strategy, grouping);
  });
  return decoder;
}

}  // namespace anigen::models
