//! Topics, and the description of the device for Home Assistant.
//!
//! The description is device-based discovery: one retained message on `PREFIX/device/radarllm_NAME/config` names all
//! entities and their topics. Home Assistant refuses a state that is not among the options of an enumeration and keeps
//! the former one, so that only [`LABELS`] and the actions that are listed here may be published.

use radarllm_monitor::messages::About;
use serde_json::{Value, json};

/// Labels that every radar has beside its actions.
pub(super) const LABELS: [&str; 4] = ["nobody", "unseen", "unsure", "other"];

/// Topics of a radar.
#[derive(Clone, Debug)]
pub(super) struct Topics {
    /// Whether the program is connected: `online` or `offline`, which is also the will.
    pub availability: String,
    /// Whether the radar is heard: `online` or `offline`.
    pub source: String,
    /// Occupancy, people, activity and falls.
    pub state: String,
    /// The newest sentence.
    pub caption: String,
    /// Transitions of falls.
    pub fall: String,
    /// The description of the device.
    pub discovery: String,
    /// Where Home Assistant says `online`.
    pub status: String,
}

impl Topics {
    pub(super) fn new(name: &str, prefix: &str) -> Self {
        let own = |end: &str| format!("radarllm/{name}/{end}");
        Self {
            availability: own("availability"),
            source: own("source/availability"),
            state: own("state"),
            caption: own("caption"),
            fall: own("fall"),
            discovery: format!("{prefix}/device/radarllm_{name}/config"),
            status: format!("{prefix}/status"),
        }
    }
}

/// The description of the device. `labels` are all values of the activity.
pub(super) fn description(about: &About, topics: &Topics, labels: &[String]) -> Value {
    let origin = &about.origin;
    let device = format!("radarllm_{}", about.name);
    let id = |entity: &str| format!("{device}_{entity}");
    json!({
        "dev": {
            "ids": [device],
            "name": title(&about.name, origin.synthetic),
            "mf": "RadarLLM",
            "mdl": origin.radar,
            "sw": origin.version,
        },
        "o": {"name": "radarllm", "sw": origin.version},
        "avty_mode": "all",
        "stat_t": topics.state,
        "qos": 1,
        "avty": [{"t": topics.availability}, {"t": topics.source}],
        "cmps": {
            "occupancy": {
                "p": "binary_sensor", "unique_id": id("occupancy"), "name": "Occupancy",
                "dev_cla": "occupancy", "val_tpl": "{{ value_json.occupancy }}",
            },
            "people": {
                "p": "sensor", "unique_id": id("people"), "name": "People",
                "stat_cla": "measurement", "val_tpl": "{{ value_json.people }}",
            },
            "activity": {
                "p": "sensor", "unique_id": id("activity"), "name": "Activity", "dev_cla": "enum",
                "ops": labels, "val_tpl": "{{ value_json.activity }}", "json_attr_t": topics.caption,
            },
            "fallen": {
                "p": "binary_sensor", "unique_id": id("fallen"), "name": "Fallen",
                "dev_cla": "safety", "val_tpl": "{{ value_json.fallen }}",
            },
            "fall": {
                "p": "event", "unique_id": id("fall"), "name": "Fall", "stat_t": topics.fall,
                "evt_typ": ["suspected", "confirmed", "dismissed", "recovered"],
            },
            "source": {
                "p": "binary_sensor", "unique_id": id("source"), "name": "Radar",
                "dev_cla": "connectivity", "ent_cat": "diagnostic", "stat_t": topics.source,
                "pl_on": "online", "pl_off": "offline", "avty": [{"t": topics.availability}],
            },
        },
    })
}

/// Name of the device, for example `Living room radar`.
fn title(name: &str, synthetic: bool) -> String {
    let words = name.replace('_', " ");
    let mut letters = words.chars();
    let first = letters.next().map(|c| c.to_ascii_uppercase());
    let words: String = first.into_iter().chain(letters).collect();
    match synthetic {
        true => format!("{words} radar (simulated)"),
        false => format!("{words} radar"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::tests::about;

    /// As it ran in Home Assistant 2025.4.4.
    const GOLDEN: &str = r#"
        {"dev":{"ids":["radarllm_lounge"],"name":"Lounge radar","mf":"RadarLLM","mdl":"awr1843boost","sw":"0.1.0"},"o":{"name":"radarllm","sw":"0.1.0"},"avty_mode":"all","stat_t":"radarllm/lounge/state","qos":1,
         "avty":[{"t":"radarllm/lounge/availability"},{"t":"radarllm/lounge/source/availability"}],"cmps":{
         "occupancy":{"p":"binary_sensor","unique_id":"radarllm_lounge_occupancy","name":"Occupancy","dev_cla":"occupancy","val_tpl":"{{ value_json.occupancy }}"},
         "people":{"p":"sensor","unique_id":"radarllm_lounge_people","name":"People","stat_cla":"measurement","val_tpl":"{{ value_json.people }}"},
         "activity":{"p":"sensor","unique_id":"radarllm_lounge_activity","name":"Activity","dev_cla":"enum","ops":["nobody","unseen","unsure","other","walk"],"val_tpl":"{{ value_json.activity }}","json_attr_t":"radarllm/lounge/caption"},
         "fallen":{"p":"binary_sensor","unique_id":"radarllm_lounge_fallen","name":"Fallen","dev_cla":"safety","val_tpl":"{{ value_json.fallen }}"},
         "fall":{"p":"event","unique_id":"radarllm_lounge_fall","name":"Fall","stat_t":"radarllm/lounge/fall","evt_typ":["suspected","confirmed","dismissed","recovered"]},
         "source":{"p":"binary_sensor","unique_id":"radarllm_lounge_source","name":"Radar","dev_cla":"connectivity","ent_cat":"diagnostic","stat_t":"radarllm/lounge/source/availability","pl_on":"online","pl_off":"offline","avty":[{"t":"radarllm/lounge/availability"}]}}}"#;

    #[test]
    fn the_description_is_the_one_that_home_assistant_took() {
        let mut about = about();
        about.origin.synthetic = false;
        let topics = Topics::new("lounge", "homeassistant");
        assert_eq!(
            topics.discovery,
            "homeassistant/device/radarllm_lounge/config"
        );
        assert_eq!(topics.status, "homeassistant/status");
        let mut labels: Vec<String> = LABELS.map(String::from).into();
        labels.push("walk".into());
        let golden: Value = serde_json::from_str(GOLDEN).unwrap();
        assert_eq!(description(&about, &topics, &labels), golden);
    }

    #[test]
    fn names_are_titles_and_simulated_radars_say_so() {
        assert_eq!(title("living_room", false), "Living room radar");
        assert_eq!(title("lounge", true), "Lounge radar (simulated)");
    }
}
