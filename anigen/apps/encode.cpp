#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/pipeline/encode_sparse_structure.h"

namespace {

using namespace anigen;

void encode(const pipeline::EncodeRequest& options, const CommonOptions& common) {
  at::set_num_threads(common.threads > 0 ? common.threads : thread_count());
  pipeline::EncodeRequest request = options;
  request.device = common.device;
  const pipeline::EncodeResult result = pipeline::encode_sparse_structure(request);
  std::fputs(common.json ? (to_json(result).dump(2) + "\n").c_str() : to_text(result).c_str(), stdout);
  if (!result.failed.empty() && result.failed.size() == result.assets) {
    throw Error("no asset could be encoded; the first: " + result.failed.begin()->second);
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Writes the latents that the flow stages learn from, by the encoder of a trained stage.\n\n"
      "  anigen-encode ss --run runs/ss_dae --data data/tiny\n"
      "  anigen-encode ss --run runs/ss_dae --data data/tiny --name ss_dae_b --check\n"};
  CommonOptions common;
  pipeline::EncodeRequest request;
  app.require_subcommand(1);
  CLI::App* ss = app.add_subcommand("ss", "Latents of the sparse structure: ss_latents/<name>, for stage 4");
  ss->fallthrough();  // so that the common options may stand after the word
  ss->add_option("--run", request.run, "Run folder of stage 2")->required();
  ss->add_option("--data", request.data, "Dataset root")->required();
  ss->add_option("--name", request.name, "Name of the latents [that of the run folder]");
  ss->add_option("--ckpt", request.ckpt, "Checkpoint: final, or the part of a file name after encoder_ [the newest]");
  ss->add_flag("--check", request.check, "Also decode every latent and compare it with the voxels");
  ss->add_flag("--again", request.again, "Encode also what is up to date");
  add_common_options(app, common);
  return run_command(app, common, argc, argv, [&] { encode(request, common); });
}
