#include "anigen/engine/animate.h"

#include "anigen/core/process.h"
#include "anigen/engine/animate_request.h"
#include "anigen/engine/module.h"
#include "anigen/engine/option_names.h"
#include "anigen/motions/animate_files.h"

namespace anigen::engine {

namespace {

constexpr OptionName kMotionNames[] = {{"--motion", "motions"}};

}  // namespace

std::vector<Animation> animate(const Asset& asset, const AnimateOptions& options, Job* job) {
  quiet_log();
  const JobScope scope(job);
  return with_library_words(kMotionNames,
                            [&] { return motions::clips_of(asset, options.motions, motion_options(options)); });
}

std::vector<std::string> motion_words() {
  std::vector<std::string> words;
  for (const motions::BuiltInMotion& one : motions::built_in_motions()) words.emplace_back(one.word);
  return words;
}

std::vector<std::string> motions_of(const Asset& asset) { return motions::motions_of(motions::analyse(asset)); }

}  // namespace anigen::engine
