#pragma once
#include "anigen/geometry/vote_clustering.h"
#include "anigen/models/run_model.h"
#include "anigen/models/structured_latent_decoder.h"
#include "anigen/models/structured_latent_encoder.h"
#include "anigen/models/structured_latent_variant.h"

namespace anigen::models {

/// Class names of the two models of stage 3 in configs.
inline constexpr const char* kStructuredLatentEncoderClass = "AniGenElasticSLatEncoder";
inline constexpr const char* kStructuredLatentDecoderClass = "AniGenElasticSLatMeshDecoder";

/// A trained model of stage 3 for use: weights loaded strictly, in fp32, evaluation mode, nothing asks for gradients.
/// @param found by find_run_model() @throws InputError when arguments or weights do not fit
StructuredLatentEncoder load_structured_latent_encoder(const RunModel& found, torch::Device device);
StructuredLatentDecoder load_structured_latent_decoder(const RunModel& found, torch::Device device);

/// Which variant the run of a decoder trained, from its config. @param decoder by find_run_model()
StructuredLatentVariant variant_of_run(const RunModel& decoder);
/// The decoder as its run's variant decodes whole rigs: votes are grouped with the variant's confidences.
/// @throws InputError as above, and for a run that trained the shape alone, whose skeletons and weights mean nothing
/// @param grouping of votes by mean shift; the published values leave many joints of decoders that trained briefly
StructuredLatentDecoder load_rig_decoder(const RunModel& found, torch::Device device,
                                         const geometry::MeanShiftOptions& grouping = {});

}  // namespace anigen::models
