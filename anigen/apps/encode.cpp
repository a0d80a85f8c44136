#include "anigen/generate/encode.h"
#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"

namespace {

using namespace anigen;

constexpr const char* kCheckpoint = ": final, or the part of a file name after encoder_ [the newest]";

void add_encoding_options(CLI::App& command, generate::EncodeRequest& request) {
  add_option(command, "--run", request.run)->required();
  add_option(command, "--dataset", request.data)->required();
  add_option(command, "--latents-name", request.name);
  add_option(command, "--ckpt", request.ckpt, kCheckpoint);
  CLI::Option* force = add_option(command, "--force", request.again);
  add_option(command, "--accept-other-code", request.accept_other_code)->excludes(force);
}

}  // namespace

int main(int argc, char** argv) {
  Program program(
      "anigen-encode",
      "Writes the latents that the flow stages learn from, by the encoder of a trained stage, and shows what\n"
      "they decode to.",
      "  anigen-encode ss --run runs/ss_dae -d data/tiny\n"
      "  anigen-encode ss --run runs/ss_dae -d data/tiny --latents-name ss_dae_b --check\n"
      "  anigen-encode slat --run runs/slat_dae -d data/tiny\n"
      "  anigen-encode reconstruct --run runs/slat_dae -d data/tiny --split data/tiny/splits/test.txt -o out\n"
      "  anigen-encode grouping --run runs/slat_dae -d data/tiny --split data/tiny/splits/train.txt --limit 200");
  generate::EncodeRequest structure, structured;
  EncodeArguments arguments;
  generate::ReconstructRequest& rebuilt = arguments.rebuilt;
  program.app.require_subcommand(1);
  CLI::App& ss = program.command("ss", "Latents of the sparse structure by stage 2: ss_latents/<name>, for stage 4");
  add_encoding_options(ss, structure);
  add_option(ss, "--check", structure.check);
  CLI::App& slat = program.command("slat", "Structured latents by stage 3: latents/<name>, for stage 5");
  add_encoding_options(slat, structured);
  CLI::Option* seen = add_option(slat, "--ss-flow", structured.ss_flow,
                                 ": encode at the voxels that it sees in one view of each asset, for `seen_models` of "
                                 "stage 5, with features surface and assets/; or, of a flow without images, at the "
                                 "skeleton's voxels that it finds in each asset");
  add_option(slat, "--ss-dae", structured.ss_dae)->needs(seen);
  add_option(slat, "--view", structured.view)->needs(seen)->check(whole_number(0));
  CLI::App& back = program.command("reconstruct", "Assets through the auto-encoder of stage 3, to rigged GLB files");
  add_option(back, "--run", rebuilt.run)->required();
  add_option(back, "--dataset", rebuilt.data)->required();
  add_option(back, "--id", rebuilt.ids);
  add_option(back, "--split", rebuilt.splits);
  add_option(back, "--output", rebuilt.output, ": folder of <id>.glb")->required();
  add_option(back, "--ckpt", rebuilt.ckpt, kCheckpoint);
  add_option(back, "--true-skeleton", rebuilt.true_skeleton);
  add_clustering_options(back, rebuilt.grouping);
  add_option(back, "--votes", rebuilt.votes);
  generate::GroupingRequest& grouped = arguments.grouped;
  CLI::App& grouping = program.command(
      "grouping", "Fits bandwidth and least votes of joints to a run of stage 3, or to both flows: grouping.json");
  CLI::Option* decoder = add_option(grouping, "--run", grouped.run, ": of stage 3");
  CLI::Option* first_flow = add_option(grouping, "--ss-flow", grouped.ss_flow)->excludes(decoder);
  add_option(grouping, "--slat-flow", grouped.slat_flow, ": fit to what both flows make of images")->needs(first_flow);
  add_option(grouping, "--dataset", grouped.data)->required();
  add_option(grouping, "--split", grouped.splits)->required();
  add_option(grouping, "--limit", grouped.most)->check(whole_number(0));
  add_option(grouping, "--ckpt", grouped.ckpt, kCheckpoint);
  program.add_common({"--keep-going", "--threads", "--device", "--json"}, library_versions());
  program.check = [&] {
    if (grouping.parsed() && grouped.run.empty() && grouped.slat_flow.empty())
      throw InputError("", "--run", "name the run of stage 3, or both flows with --ss-flow and --slat-flow");
    if (grouping.parsed() && !grouped.slat_flow.empty())
      refuse_given(grouping, {"--ckpt"}, "is that of --run; both flows are taken as anigen-generate takes them");
  };
  return program.run(argc, argv, [&] {
    structure.device = structured.device = rebuilt.device = grouped.device = program.common.device;
    if (grouping.parsed()) arguments.task = EncodeArguments::Task::kGrouping;
    if (ss.parsed()) arguments.encoded = structure;
    if (slat.parsed()) {
      arguments.task = EncodeArguments::Task::kStructuredLatents;
      arguments.encoded = structured;
    }
    if (back.parsed()) arguments.task = EncodeArguments::Task::kReconstruct;
    torch_half("encoding").encode(arguments, program.common);
  });
}
