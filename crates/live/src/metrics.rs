//! Counters of a running radar, in the text format of Prometheus.

use std::fmt::Write as _;
use std::sync::Arc;

use radarllm_monitor::counters::{Counter, Counters, Problem};
use radarllm_monitor::messages::{About, Body};

use crate::bus::BusCounts;
use crate::mqtt;

/// Counters that every thread raises.
#[derive(Debug, Default)]
pub struct Metrics {
    /// What happened to frames and windows.
    pub monitor: Arc<Counters>,
    /// Rows that the store could not keep.
    pub store_failures: Counter,
    /// Why the store cannot be written at present.
    pub store_problem: Problem,
    /// Why what arrives from the radar tells nothing at present.
    pub source_problem: Problem,
    /// Connections that were opened again after the radar was silent.
    pub reconnects: Counter,
    /// Datagrams of other senders than the capture card, or that are no packets of one.
    pub foreign_datagrams: Counter,
    /// Lines of the chirp file, or commands to the capture card, that were refused after an interruption.
    pub refused_lines: Counter,
    /// Searches for the next packet in a damaged stream.
    pub resynchronisations: Counter,
    /// Answers by the hundreds of their status, from 100 to 500.
    responses: [Counter; 5],
    /// Connections that were refused because there were too many.
    pub connections_refused: Counter,
}

impl Metrics {
    /// Counts an answer of the server.
    pub(crate) fn responded(&self, status: u16) {
        let hundreds = usize::from(status / 100);
        if let Some(counter) = hundreds.checked_sub(1).and_then(|i| self.responses.get(i)) {
            counter.add(1);
        }
    }

    /// All numbers in the text format of Prometheus.
    pub fn to_text(
        &self,
        about: &About,
        bus: &BusCounts,
        broker: Option<&mqtt::Counts>,
        n_problems: usize,
    ) -> String {
        let monitor = &self.monitor;
        let mut page = Page(String::with_capacity(4_096));
        page.family(
            "radarllm_info",
            "gauge",
            "Provenance of what this program tells.",
        );
        let origin = &about.origin;
        page.labelled(
            "radarllm_info",
            &[
                ("name", &about.name),
                ("radar", &origin.radar),
                ("model", &origin.model),
                ("version", &origin.version),
                ("synthetic", &origin.synthetic.to_string()),
            ],
            1.0,
        );
        page.one(
            "radarllm_problems",
            "gauge",
            "Present problems, as on /healthz.",
            n_problems as u64,
        );
        page.family(
            "radarllm_frames_total",
            "counter",
            "Frames of the radar by fate.",
        );
        for (fate, counter) in [
            ("used", &monitor.frames_used),
            ("lost", &monitor.frames_lost),
            ("dropped", &monitor.frames_dropped),
        ] {
            let n = counter.get() as f64;
            page.labelled("radarllm_frames_total", &[("fate", fate)], n);
        }
        page.family(
            "radarllm_caption_seconds",
            "summary",
            "Time that the model took for a sentence.",
        );
        page.sample(
            "radarllm_caption_seconds_sum",
            monitor.describe_ns.get() as f64 * 1e-9,
        );
        page.sample(
            "radarllm_caption_seconds_count",
            monitor.windows_described.get() as f64,
        );
        for (name, help, counter) in [
            (
                "radarllm_abstained_total",
                "Windows in which the model abstained.",
                &monitor.abstained,
            ),
            (
                "radarllm_model_errors_total",
                "Windows for which the model reported an error.",
                &monitor.model_errors,
            ),
            (
                "radarllm_windows_overwritten_total",
                "Windows that a newer one replaced before they were described.",
                &monitor.windows_overwritten,
            ),
            (
                "radarllm_store_failures_total",
                "Rows that could not be kept.",
                &self.store_failures,
            ),
            (
                "radarllm_foreign_datagrams_total",
                "Datagrams of other senders than the capture card, or that are no packets of one.",
                &self.foreign_datagrams,
            ),
            (
                "radarllm_refused_lines_total",
                "Lines of the chirp file, or commands to the capture card, that were refused after an interruption.",
                &self.refused_lines,
            ),
            (
                "radarllm_resynchronisations_total",
                "Searches for the next packet in a damaged stream.",
                &self.resynchronisations,
            ),
            (
                "radarllm_reconnects_total",
                "Connections to the radar that were opened again.",
                &self.reconnects,
            ),
            (
                "radarllm_http_connections_refused_total",
                "Connections that were refused because there were too many.",
                &self.connections_refused,
            ),
        ] {
            page.one(name, "counter", help, counter.get());
        }
        page.one(
            "radarllm_store_problem",
            "gauge",
            "Whether the memory cannot be written at present.",
            self.store_problem.get().is_some().into(),
        );
        page.family(
            "radarllm_http_responses_total",
            "counter",
            "Answers of the HTTP server by class.",
        );
        for (class, counter) in ["1xx", "2xx", "3xx", "4xx", "5xx"]
            .iter()
            .zip(&self.responses)
        {
            let n = counter.get() as f64;
            page.labelled("radarllm_http_responses_total", &[("class", class)], n);
        }
        page.bus(bus);
        if let Some(broker) = broker {
            page.broker(broker);
        }
        page.0
    }
}

struct Page(String);

impl Page {
    fn bus(&mut self, bus: &BusCounts) {
        self.family(
            "radarllm_messages_total",
            "counter",
            "Messages to listeners by type.",
        );
        for (kind, n) in Body::TYPES.iter().zip(bus.published) {
            self.labelled("radarllm_messages_total", &[("type", kind)], n as f64);
        }
        self.one(
            "radarllm_listeners",
            "gauge",
            "Listeners at present.",
            bus.readers as u64,
        );
        self.one(
            "radarllm_listener_frames_dropped_total",
            "counter",
            "Frames that slow listeners lost.",
            bus.frames_dropped,
        );
        self.one(
            "radarllm_listeners_closed_total",
            "counter",
            "Listeners that were closed because they were too slow.",
            bus.readers_closed,
        );
    }

    fn broker(&mut self, broker: &mqtt::Counts) {
        self.one(
            "radarllm_broker_connected",
            "gauge",
            "Whether the MQTT broker is connected.",
            broker.connected.into(),
        );
        for (name, help, n) in [
            (
                "radarllm_broker_reconnects_total",
                "Connections to the MQTT broker after the first one.",
                broker.reconnects,
            ),
            (
                "radarllm_broker_messages_total",
                "Messages that the MQTT broker acknowledged.",
                broker.published,
            ),
            (
                "radarllm_broker_messages_dropped_total",
                "Messages that were too old, too many or not allowed for the MQTT broker.",
                broker.dropped,
            ),
        ] {
            self.one(name, "counter", help, n);
        }
    }

    fn family(&mut self, name: &str, kind: &str, help: &str) {
        // Writing to a string does not fail.
        let _ = write!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}\n");
    }

    fn one(&mut self, name: &str, kind: &str, help: &str, n: u64) {
        self.family(name, kind, help);
        self.sample(name, n as f64);
    }

    fn sample(&mut self, name: &str, value: f64) {
        let _ = writeln!(self.0, "{name} {value}");
    }

    fn labelled(&mut self, name: &str, labels: &[(&str, &str)], value: f64) {
        let labels: Vec<String> = labels
            .iter()
            .map(|(key, value)| format!("{key}=\"{}\"", escape(value)))
            .collect();
        let _ = writeln!(self.0, "{name}{{{}}} {value}", labels.join(","));
    }
}

fn escape(value: &str) -> String {
    value
        .replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::bus::Bus;
    use crate::bus::tests::about;

    #[test]
    fn every_sample_belongs_to_a_described_family() {
        let metrics = Metrics::default();
        metrics.monitor.frames_used.add(3);
        metrics.monitor.described(Duration::from_millis(250));
        metrics.monitor.model_failed("no weights".into());
        metrics.responded(404);
        metrics.responded(999);
        metrics.foreign_datagrams.raise_to(7);
        metrics.foreign_datagrams.raise_to(5);
        metrics.store_problem.set(Some("a full disk".into()));
        let mut about = about();
        about.name = "a \"b\"\n\\c".into();
        let broker = mqtt::Counts {
            connected: true,
            reconnects: 4,
            published: 5,
            dropped: 6,
            status_ignored: false,
        };
        let bus = Bus::new(about.clone()).counts();
        let text = metrics.to_text(&about, &bus, Some(&broker), 2);
        assert!(!metrics.to_text(&about, &bus, None, 2).contains("broker"));
        let mut family = "";
        for line in text.lines() {
            if let Some(rest) = line.strip_prefix("# HELP ") {
                family = rest.split(' ').next().unwrap();
            } else if !line.starts_with('#') {
                assert!(line.starts_with(family), "{line} after {family}");
                let value = line.rsplit(' ').next().unwrap();
                assert!(value.parse::<f64>().is_ok(), "{line}");
            }
        }
        for wanted in [
            "radarllm_frames_total{fate=\"used\"} 3\n",
            "radarllm_caption_seconds_sum 0.25\n",
            "radarllm_http_responses_total{class=\"4xx\"} 1\n",
            "radarllm_model_errors_total 1\n",
            "radarllm_caption_seconds_count 1\n",
            "radarllm_problems 2\n",
            "radarllm_foreign_datagrams_total 7\n",
            "radarllm_store_problem 1\n",
            "radarllm_broker_connected 1\n",
            "radarllm_broker_messages_dropped_total 6\n",
            "name=\"a \\\"b\\\"\\n\\\\c\"",
        ] {
            assert!(text.contains(wanted), "{wanted} in {text}");
        }
    }
}
