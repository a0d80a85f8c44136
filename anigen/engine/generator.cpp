#include "anigen/engine/generator.h"

#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/engine/module.h"
#include "anigen/engine/option_names.h"

namespace anigen::engine {

namespace {

constexpr OptionName kGeneratorNames[] = {{"--runs", "runs"},
                                          {"--ss-flow", "structure_flow"},
                                          {"--slat-flow", "latent_flow"},
                                          {"--background", "background"},
                                          {"--device", "device"}};

}  // namespace

Generator::Generator(const GeneratorOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  if (job != nullptr) job->report("loading models", 0.0);
  work_ = with_library_words(kGeneratorNames, [&] { return engine_module("generation").generator(options); });
  if (job != nullptr) job->report("loading models", 1.0);
}

Generator::~Generator() = default;
Generator::Generator(Generator&&) noexcept = default;
Generator& Generator::operator=(Generator&&) noexcept = default;

Generated Generator::generate(const std::filesystem::path& image, const GenerateOptions& options, Job* job) {
  const JobScope scope(job);
  throw_if_interrupted();
  return with_library_words(kGeneratorNames, [&] { return work_->generate(image, "", options); });
}

Generated Generator::generate_bytes(const std::string& image, const GenerateOptions& options, Job* job) {
  if (image.empty()) throw InputError("", "image", "is empty");
  const JobScope scope(job);
  throw_if_interrupted();
  return with_library_words(kGeneratorNames, [&] { return work_->generate("image", image, options); });
}

}  // namespace anigen::engine
