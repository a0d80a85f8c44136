#pragma once
/// Metrics of skeletons, skin weights, surfaces, images and motion, each a library of small functions. Skeletons
/// (metric_skeleton.h): chamfer.h, matching.h, tree_edit.h. Optimal transport: wasserstein.h, sinkhorn.h,
/// gromov_wasserstein.h. Alignment: icp.h, alignment.h.
#include "anigen/metrics/alignment.h"
#include "anigen/metrics/chamfer.h"
#include "anigen/metrics/deformation.h"
#include "anigen/metrics/gromov_wasserstein.h"
#include "anigen/metrics/gw_bound.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/icp.h"
#include "anigen/metrics/image.h"
#include "anigen/metrics/matching.h"
#include "anigen/metrics/metric_skeleton.h"
#include "anigen/metrics/motion.h"
#include "anigen/metrics/published_protocols.h"
#include "anigen/metrics/similarity.h"
#include "anigen/metrics/sinkhorn.h"
#include "anigen/metrics/skeleton_transport.h"
#include "anigen/metrics/skin_metrics.h"
#include "anigen/metrics/surface.h"
#include "anigen/metrics/transport_plan.h"
#include "anigen/metrics/tree_edit.h"
#include "anigen/metrics/wasserstein.h"
