#pragma once
#include "anigen/engine/generator.h"
#include "anigen/generate/generate_assets.h"

namespace anigen::engine {

/// Models, handling of images and colours by the options, those of a Generator and of anigen-generate; without
/// matting (with_shipped_matting()).
/// @param further what the library has no option for: auto-encoders, normals, finishing, files
/// @throws InputError for an unknown word, or when runs are missing; it names the program's options
generate::GenerateRequest generation_request(const GeneratorOptions& options, generate::GenerateRequest further = {});

/// Sampling by the options, those of a Generator and of anigen-generate; without given voxels.
/// @param further what the library has no option for: solver, intervals, several views
/// @throws InputError for a stage that nothing can stop at
generate::GenerationOptions sampling_options(const GenerateOptions& options, generate::GenerationOptions further = {});

/// The network that is asked for; without one that of the shipped weights, where the background may need one.
generate::MattingOptions with_shipped_matting(generate::MattingOptions asked, generate::Background background);

}  // namespace anigen::engine
