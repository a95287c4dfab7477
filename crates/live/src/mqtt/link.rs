//! One connection to a broker: the only file that knows the MQTT library.
//!
//! A link is used for one connection and then dropped, so that nothing of a broken connection reaches the next one. All
//! messages have QoS 1.

use std::time::Duration;

use rumqttc::mqttbytes::Error as BytesError;
use rumqttc::{
    AsyncClient, ConnectionError, Event, EventLoop, LastWill, MqttOptions, Packet, QoS, StateError,
};
use tokio::sync::mpsc::{Receiver, Sender, channel};
use tokio::task::JoinHandle;

use super::options::Options;

/// Most bytes of a packet, in both directions.
pub(super) const MAX_PACKET: usize = 64 << 10;
/// Time between signs of life. A broker gives a silent client up after one and a half of it.
const KEEP_ALIVE: Duration = Duration::from_secs(10);
/// Requests that may wait: one subscription, all transitions of falls and a few topics.
const MAX_REQUESTS: usize = 64;
/// Events that may wait. A link that is not read does not read from the broker.
const MAX_EVENTS: usize = 16;
/// How long the broker may take to close a connection that is over.
const CLOSE_TIME: Duration = Duration::from_millis(300);
/// Longest reason, characters. Parts of it may come from the broker.
const MAX_REASON: usize = 200;

/// What happened on a link.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum LinkEvent {
    /// The broker took the connection.
    Connected,
    /// The broker has one more of the messages, in the order in which they were published.
    Acknowledged,
    /// A message arrived.
    Message {
        /// Its topic.
        topic: String,
        /// Its payload.
        payload: Vec<u8>,
        /// Whether it was kept by the broker from before the subscription.
        retained: bool,
    },
    /// The connection is over, and this link has no more events.
    Lost {
        /// Why, in words.
        reason: String,
        /// Whether a packet was longer than [`MAX_PACKET`].
        oversized: bool,
    },
}

/// The last will of a connection.
pub(super) struct Will<'a> {
    /// Topic.
    pub topic: &'a str,
    /// Payload. It is retained.
    pub payload: &'a str,
}

/// A connection, or the attempt to make one.
#[derive(Debug)]
pub(super) struct Link {
    client: AsyncClient,
    events: Receiver<LinkEvent>,
    task: JoinHandle<()>,
}

impl Link {
    /// Begins to connect. It must be called within a runtime.
    pub(super) fn open(options: &Options, client_id: &str, will: &Will<'_>) -> Self {
        let address = &options.address;
        // The library puts a colon and the port behind the host.
        let host = match address.host.contains(':') {
            true => format!("[{}]", address.host),
            false => address.host.clone(),
        };
        let mut mqtt = MqttOptions::new(client_id, host, address.port);
        mqtt.set_keep_alive(KEEP_ALIVE)
            .set_clean_session(true)
            .set_max_packet_size(MAX_PACKET, MAX_PACKET)
            .set_last_will(LastWill::new(
                will.topic,
                will.payload,
                QoS::AtLeastOnce,
                true,
            ));
        if let Some(user) = &options.user {
            let password = options.password.as_ref().map_or("", |p| p.reveal());
            mqtt.set_credentials(user, password);
        }
        let (client, mut events_of_client) = AsyncClient::new(mqtt, MAX_REQUESTS);
        events_of_client.network_options.set_tcp_nodelay(true);
        let (sender, events) = channel(MAX_EVENTS);
        // A task of its own, because waiting for the next event must not be given up half-way.
        let task = tokio::spawn(poll(events_of_client, sender));
        Self {
            client,
            events,
            task,
        }
    }

    /// The next event. After [`LinkEvent::Lost`] there is none.
    pub(super) async fn next(&mut self) -> LinkEvent {
        let event = self.events.recv().await;
        event.unwrap_or_else(|| LinkEvent::Lost {
            reason: "the connection ended".into(),
            oversized: false,
        })
    }

    /// Publishes a message. Returns false if too many wait.
    pub(super) fn publish(&self, topic: &str, payload: &str, retain: bool) -> bool {
        let published = self
            .client
            .try_publish(topic, QoS::AtLeastOnce, retain, payload);
        published.is_ok()
    }

    /// Subscribes to a topic. Returns false if too many requests wait.
    pub(super) fn subscribe(&self, topic: &str) -> bool {
        self.client.try_subscribe(topic, QoS::AtLeastOnce).is_ok()
    }

    /// Ends the connection so that the broker does not publish the will.
    pub(super) async fn close(mut self) {
        // A full queue ends with the will, which says the same.
        let _ = self.client.try_disconnect();
        // Most brokers close the connection when they have read the farewell. The others have had time to read it.
        let closed = async { while !matches!(self.next().await, LinkEvent::Lost { .. }) {} };
        let _ = tokio::time::timeout(CLOSE_TIME, closed).await;
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.task.abort();
    }
}

/// Hands events on until the connection or the link is over.
async fn poll(mut events: EventLoop, sender: Sender<LinkEvent>) {
    loop {
        let event = match events.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => LinkEvent::Connected,
            Ok(Event::Incoming(Packet::PubAck(_))) => LinkEvent::Acknowledged,
            Ok(Event::Incoming(Packet::Publish(message))) => LinkEvent::Message {
                topic: message.topic,
                payload: message.payload.into(),
                retained: message.retain,
            },
            Ok(Event::Incoming(_) | Event::Outgoing(_)) => continue,
            Err(error) => {
                let lost = LinkEvent::Lost {
                    reason: reason(&error),
                    oversized: is_oversized(&error),
                };
                // The owner may be gone.
                let _ = sender.send(lost).await;
                return;
            }
        };
        if sender.send(event).await.is_err() {
            return;
        }
    }
}

/// The error in words, short and fit for a terminal.
fn reason(error: &ConnectionError) -> String {
    let text = error.to_string();
    let plain = text.chars().filter(|c| !c.is_control());
    plain.take(MAX_REASON).collect()
}

fn is_oversized(error: &ConnectionError) -> bool {
    let ConnectionError::MqttState(StateError::Deserialization(error)) = error else {
        return false;
    };
    matches!(error, BytesError::PayloadSizeLimitExceeded(_))
}
