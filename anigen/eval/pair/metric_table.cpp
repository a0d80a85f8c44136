#include "anigen/eval/pair/metric_table.h"

namespace anigen::eval {

const std::vector<MetricInfo>& metric_table() {
  constexpr Better kLow = Better::kLower, kHigh = Better::kHigher;
  static const std::vector<MetricInfo> kTable = {
      {"j2j", "J2J", kLow, "box", "skeleton", true},
      {"j2b", "J2B", kLow, "box", "skeleton", true},
      {"b2b", "B2B", kLow, "box", "skeleton", true},
      {"wasserstein", "W", kLow, "box", "transport", true},
      {"gromov_wasserstein", "GW", kLow, "box", "transport", true},
      {"gw_lower_bound", "GW bound", Better::kNeither, "box", "transport", false},
      {"fused_gromov_wasserstein", "FGW", kLow, "box", "transport", false},
      {"skin_l1", "skin l1", kLow, "sum over joints", "skin", true},
      {"skin_l2", "skin l2", kLow, "norm over joints", "skin", true},
      {"skin_kl", "skin KL", kLow, "nats", "skin", true},
      {"deformation_error", "deform", kLow, "box", "skin", true},
      {"skin_precision", "skin prec", kHigh, "1", "skin", false},
      {"skin_recall", "skin rec", kHigh, "1", "skin", false},
      {"skin_ce", "skin CE", kLow, "nats", "skin", false},
      {"skin_cos", "skin cos", kHigh, "1", "skin", false},
      {"skin_mae", "skin MAE", kLow, "mean over joints", "skin", false},
      {"motion_distance", "motion", kLow, "box", "motion", true},
      {"motion_distance_rest", "motion at rest", kLow, "box", "motion", false},
      {"surface_chamfer", "Chamfer", kLow, "box", "surface", true},
      {"fscore", "F 0.05", kHigh, "1", "surface", true},
      {"fscore_001", "F 0.01", kHigh, "1", "surface", false},
      {"normal_consistency", "normals", kHigh, "1", "surface", false},
      {"category", "category", kHigh, "1", "surface", false},
      {"psnr", "PSNR", kHigh, "dB", "image", false},
      {"ssim", "SSIM", kHigh, "1", "image", false},
      {"lpips", "LPIPS", kLow, "1", "image", false},
      {"rignet.j2j", "RigNet J2J", kLow, "box", "skeleton", false},
      {"rignet.j2b", "RigNet J2B", kLow, "box", "skeleton", false},
      {"rignet.b2b", "RigNet B2B", kLow, "box", "skeleton", false},
      {"rignet.iou", "IoU", kHigh, "1", "skeleton", false},
      {"rignet.precision", "joint prec", kHigh, "1", "skeleton", false},
      {"rignet.recall", "joint rec", kHigh, "1", "skeleton", false},
      {"unirig.j2j", "UniRig J2J", kLow, "box", "skeleton", false},
      {"unirig.j2b", "UniRig J2B", kLow, "box", "skeleton", false},
      {"unirig.b2b", "UniRig B2B", kLow, "box", "skeleton", false},
      {"puppeteer.j2j", "Puppeteer J2J", kLow, "box", "skeleton", false},
      {"puppeteer.j2b", "Puppeteer J2B", kLow, "box", "skeleton", false},
      {"puppeteer.b2b", "Puppeteer B2B", kLow, "box", "skeleton", false},
      {"connectivity_precision", "bone prec", kHigh, "1", "skeleton", false},
      {"connectivity_recall", "bone rec", kHigh, "1", "skeleton", false},
      {"joints", "joints", Better::kNeither, "joints", "skeleton", false},
      {"joint_count_error", "joints off", kLow, "joints", "skeleton", false},
      {"tree_edit_distance", "tree edits", kLow, "edits", "skeleton", false},
      {"anymate_cd", "Anymate CD", kLow, "box of side 2", "anymate", false},
      {"anymate_emd", "Anymate EMD", kLow, "box of side 2", "anymate", false},
      {"anymate_emd_exact", "exact EMD", kLow, "box of side 2", "anymate", false},
      {"anymate_precision", "Anymate prec", kHigh, "1", "anymate", false},
      {"anymate_recall", "Anymate rec", kHigh, "1", "anymate", false},
      {"icp_rmse", "ICP", kLow, "box", "run", false},
      {"seconds", "seconds", Better::kNeither, "s", "run", false},
  };
  return kTable;
}

const MetricInfo* find_metric(const std::string& key) {
  for (const MetricInfo& info : metric_table()) {
    if (info.key == key) return &info;
  }
  return nullptr;
}

std::string arrow(Better better) {
  switch (better) {
    case Better::kLower:
      return "↓";
    case Better::kHigher:
      return "↑";
    case Better::kNeither:
      break;
  }
  return "";
}

}  // namespace anigen::eval
