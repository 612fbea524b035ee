// Settings of the unit `diagnosis`: default, unit, range and help of each, in one place.
#pragma once

#include "core/plugin_sdk.h"
#include "plugins/diagnosis/innovation_watch.h"

namespace teres {

struct DiagnosisSettings {
    int num_refits = 5;
    double work_limit_s = 600.0;
    double work_limit_dynamic_s = 3600.0;
    double false_alarm_period_s = 7200.0;
    double learning_s = 3.0;
    double forgetting_s = 60.0;
    double hold_s = 5.0;

    template <class V>
    void visit(V& field) {
        field("num_refits", num_refits, {3, 26}, "offline: effects that are refitted nonlinearly after screening");
        field("work_limit_s", work_limit_s, {0.0, 1e6},
              "offline: processor time after which what was found is answered, marked as cut short; 0: none [s]");
        field("work_limit_dynamic_s", work_limit_dynamic_s, {0.0, 1e6},
              "offline: the same for recordings with inertia, whose hypotheses cost more and wait at no table [s]");
        field("false_alarm_period_s", false_alarm_period_s, {1.0, 1e7},
              "live: mean time between false alarms that the bound of GAP is made for [s]");
        field("learning_s", learning_s, {0.5, 3600.0},
              "live: level, spread and correlation of the innovations are learnt so long, with no alarm but of what is "
              "gross [s]");
        field("forgetting_s", forgetting_s, {1.0, 1e5}, "live: time constant with which they follow slow changes [s]");
        field("hold_s", hold_s, {0.1, 3600.0}, "live: an alarm stands so long, then the new state is learnt [s]");
    }

    InnovationWatchOptions watch_options() const {
        InnovationWatchOptions o;
        o.false_alarm_period_s = false_alarm_period_s;
        o.learning_s = learning_s;
        o.forgetting_s = forgetting_s;
        o.hold_s = hold_s;
        return o;
    }
};

}  // namespace teres
