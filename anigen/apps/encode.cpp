#include "anigen/apps/common/grouping_options.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/apps/encode_arguments.h"

namespace {

using namespace anigen;

void add_encoding_options(CLI::App& command, generate::EncodeRequest& request, const std::string& stage) {
  command.fallthrough();  // so that the common options may stand after the word
  command.add_option("--run", request.run, "Run folder of stage " + stage)->required();
  command.add_option("--data", request.data, "Dataset root")->required();
  command.add_option("--name", request.name, "Name of the latents [that of the run folder]");
  command.add_option("--ckpt", request.ckpt,
                     "Checkpoint: final, or the part of a file name after encoder_ [the newest]");
  CLI::Option* again = command.add_flag("--again", request.again, "Encode also what is up to date");
  command
      .add_flag("--accept-other-code", request.accept_other_code,
                "Keep latents that another build of this program encoded, when all else is the same")
      ->excludes(again);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Writes the latents that the flow stages learn from, by the encoder of a trained stage, and shows what they\n"
      "decode to.\n\n"
      "  anigen-encode ss --run runs/ss_dae --data data/tiny\n"
      "  anigen-encode ss --run runs/ss_dae --data data/tiny --name ss_dae_b --check\n"
      "  anigen-encode slat --run runs/slat_dae --data data/tiny\n"
      "  anigen-encode reconstruct --run runs/slat_dae --data data/tiny --split data/tiny/splits/test.txt --output "
      "out\n"};
  CommonOptions common;
  generate::EncodeRequest structure, structured;
  EncodeArguments arguments;
  generate::ReconstructRequest& rebuilt = arguments.rebuilt;
  app.require_subcommand(1);
  CLI::App* ss = app.add_subcommand("ss", "Latents of the sparse structure: ss_latents/<name>, for stage 4");
  add_encoding_options(*ss, structure, "2");
  ss->add_flag("--check", structure.check, "Also decode every latent and compare it with the voxels");
  CLI::App* slat = app.add_subcommand("slat", "Structured latents: latents/<name>, for stage 5");
  add_encoding_options(*slat, structured, "3");
  CLI::App* back = app.add_subcommand("reconstruct", "Assets through the auto-encoder of stage 3, to rigged GLB files");
  back->fallthrough();
  back->add_option("--run", rebuilt.run, "Run folder of stage 3")->required();
  back->add_option("--data", rebuilt.data, "Dataset root")->required();
  back->add_option("--id", rebuilt.ids, "Asset of the dataset; repeatable");
  back->add_option("--split", rebuilt.split, "File of more ids, such as splits/test.txt");
  back->add_option("--output", rebuilt.output, "Folder of the files <id>.glb")->required();
  back->add_option("--ckpt", rebuilt.ckpt, "Checkpoint: final, or the part of a file name after encoder_ [the newest]");
  back->add_flag("--true-skeleton", rebuilt.true_skeleton, "Decode weights for the asset's own skeleton");
  back->add_flag("--allow-failures", arguments.allow_failures, "Exit with 0 when at least one asset gave a file");
  add_grouping_options(*back, rebuilt.grouping);
  back->add_flag("--votes", rebuilt.votes,
                 "Also <id>.votes.glb and .ply: the voxels' votes for joints, coloured by confidence");
  add_common_options(app, common, library_versions(), {{"--seed", "draws nothing at random"}});
  return run_command(app, common, argc, argv, [&] {
    structure.device = structured.device = rebuilt.device = common.device;
    if (ss->parsed()) arguments.encoded = structure;
    if (slat->parsed()) {
      arguments.task = EncodeArguments::Task::kStructuredLatents;
      arguments.encoded = structured;
    }
    if (back->parsed()) arguments.task = EncodeArguments::Task::kReconstruct;
    torch_half("encoding").encode(arguments, common);
  });
}
