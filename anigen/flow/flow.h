#pragma once
/// Flow matching: paths, time schedules, condition dropout, samplers with guidance, geodesic noise.
#include "anigen/flow/geodesic_noise.h"
#include "anigen/flow/matching.h"
#include "anigen/flow/sampler.h"
#include "anigen/flow/several_views.h"
