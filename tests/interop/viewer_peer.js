#!/usr/bin/env node
// A viewer with Lichtblick's client and decoder (@foxglove/ws-protocol, @foxglove/rosmsg2-serialization), without its screen.
//
// usage: viewer_peer.js URL SUBPROTOCOL FILE TOPIC [--ask]
//
// Subscribes to all channels, decodes each message with the channel's schema, and writes it again: the bytes must be the same. Writes the
// payloads of TOPIC to FILE, a line of hexadecimal digits each. With --ask it also asks for parameters, sets one, and publishes. Ends when
// its standard input closes, and prints one line of JSON: channels with their counts, statuses, parameters. The directory with the packages
// is $VIEWER_PACKAGES.

const path = require("node:path");
const fs = require("node:fs");

const packages = process.env.VIEWER_PACKAGES;
if (packages == undefined) {
  console.error("viewer_peer.js: VIEWER_PACKAGES is not set; run tests/interop/setup.sh viewer and name its directory");
  process.exit(1);
}
const load = (name) => require(path.join(packages, "node_modules", name));
const { FoxgloveClient } = load("@foxglove/ws-protocol");
const { parse } = load("@foxglove/rosmsg");
const { MessageReader, MessageWriter } = load("@foxglove/rosmsg2-serialization");
const { WebSocket } = load("ws");

const [url, subprotocol, file, kept, ask] = process.argv.slice(2);
const socket = new WebSocket(url, [subprotocol]);
const client = new FoxgloveClient({ ws: socket });
const result = { protocol: "", info: null, channels: {}, statuses: [], parameters: {}, parameter_ids: [], errors: [], times: 0, last_time: "" };
const bySubscription = new Map();
const lines = [];

const fail = (what) => {
  if (result.errors.length < 10) {
    result.errors.push(String(what));
  }
};

client.on("error", (error) => fail(error));
client.on("open", () => {
  result.protocol = socket.protocol;
});
client.on("serverInfo", (info) => {
  result.info = info;
  console.log(JSON.stringify({ connected: socket.protocol }));
});
client.on("advertise", (channels) => {
  for (const channel of channels) {
    const of = { schema: channel.schemaName, messages: 0, rewritten: 0, other_times: 0, last: null };
    result.channels[channel.topic] = of;
    if (channel.encoding !== "cdr" || channel.schemaEncoding !== "ros2msg") {
      fail(`${channel.topic}: ${channel.encoding}, ${channel.schemaEncoding}`);
      continue;
    }
    const definitions = parse(channel.schema, { ros2: true });
    const [reader, writer] = [new MessageReader(definitions), new MessageWriter(definitions)];
    bySubscription.set(client.subscribe(channel.id), { topic: channel.topic, of, reader, writer });
  }
});
client.on("time", ({ timestamp }) => {
  result.times += 1;
  result.last_time = String(timestamp);
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { topic, of, reader, writer } = bySubscription.get(subscriptionId);
  const bytes = Buffer.from(data.buffer, data.byteOffset, data.byteLength);
  of.messages += 1;
  try {
    const message = reader.readMessage(bytes);
    of.rewritten += Number(Buffer.from(writer.writeMessage(message)).equals(bytes));
    const stamp = message.header?.stamp;
    const isStamped = stamp != undefined && BigInt(stamp.sec) * 1000000000n + BigInt(stamp.nsec ?? stamp.nanosec) === timestamp;
    of.other_times += Number(!isStamped);
    of.last = message;
  } catch (error) {
    fail(`${topic}: ${error}`);
  }
  if (topic === kept) {
    lines.push(bytes.toString("hex"));
  }
});
client.on("status", ({ level, message }) => result.statuses.push({ level, message }));
client.on("parameterValues", ({ parameters, id }) => {
  result.parameter_ids.push(id ?? null);
  for (const { name, value, type } of parameters) {
    result.parameters[name] = { value, type };
  }
});
client.on("close", () => fail("the server has closed the connection"));

if (ask === "--ask") {
  client.on("serverInfo", () => {
    setTimeout(() => {
      client.getParameters([], "all");
      client.setParameters([{ name: "/mr_damper.coast_s", value: 99.0, type: "float64" }], "set");
      const id = client.advertise({ topic: "/displacement", encoding: "cdr", schemaName: "mr_damper_msgs/msg/Displacement" });
      client.sendMessage(id, new Uint8Array([0, 1, 0, 0]));
    }, 2000);
    // As Lichtblick does, which then shows the present values.
    setTimeout(() => client.getParameters([], "again"), 6000);
  });
}

process.stdin.resume();
process.stdin.on("end", () => {
  fs.writeFileSync(file, lines.map((line) => `${line}\n`).join(""));
  const plain = (_, value) => (typeof value === "bigint" ? String(value) : value);
  console.log(JSON.stringify(result, plain));
  process.exit(0);
});
