#!/usr/bin/env bash
# Makes keystores in the layout of `ros2 security create_keystore` and `create_enclave`, with openssl only.
#
# usage: keystore.sh DIRECTORY
#
# DIRECTORY/ours has enclaves that trust each other, DIRECTORY/strangers has one of another authority. The governance is the default of
# sros2: everything is authenticated, access-controlled and encrypted.
#   /node    has all permissions of the node
#   /narrow  has the same permissions, except publishing force_estimate
#   /sensor  may publish displacement and coil_current, and subscribe to force_estimate
#   /axle    has the same permissions; its GUID is lower than /node's, so it begins the handshake with /node
#   /tools   has all permissions of /node
#   /deaf    may only publish what /sensor may publish
#   /mute    may only subscribe to force_estimate
set -euo pipefail
[ $# = 1 ] || {
  echo "usage: keystore.sh DIRECTORY" >&2
  exit 2
}

certificate_authority() {
  mkdir -p "$1/public" "$1/private" "$1/enclaves"
  openssl ecparam -name prime256v1 -genkey -noout -out "$1/private/ca.key.pem"
  openssl req -x509 -new -sha256 -key "$1/private/ca.key.pem" -subj "/CN=$2" -days 3650 -out "$1/public/ca.cert.pem"
}

# Signs standard input into a file.
sign() {
  openssl smime -sign -text -md sha256 -signer "$1/public/ca.cert.pem" -inkey "$1/private/ca.key.pem" -out "$2"
}

governance() {
  cat <<XML
<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd">
  <domain_access_rules>
    <domain_rule>
      <domains><id_range><min>0</min><max>230</max></id_range></domains>
      <allow_unauthenticated_participants>false</allow_unauthenticated_participants>
      <enable_join_access_control>true</enable_join_access_control>
      <discovery_protection_kind>ENCRYPT</discovery_protection_kind>
      <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
      <rtps_protection_kind>SIGN</rtps_protection_kind>
      <topic_access_rules>
        <topic_rule>
          <topic_expression>*</topic_expression>
          <enable_discovery_protection>true</enable_discovery_protection>
          <enable_liveliness_protection>true</enable_liveliness_protection>
          <enable_read_access_control>true</enable_read_access_control>
          <enable_write_access_control>true</enable_write_access_control>
          <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
          <data_protection_kind>ENCRYPT</data_protection_kind>
        </topic_rule>
      </topic_access_rules>
    </domain_rule>
  </domain_access_rules>
</dds>
XML
}

# Prints the topics of one kind of rule.
topics() {
  echo "        <$1><topics>"
  for topic in ros_discovery_info $2; do echo "          <topic>$topic</topic>"; done
  echo "        </topics></$1>"
}

permissions() {
  cat <<XML
<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
  <permissions>
    <grant name="/$1">
      <subject_name>CN=/$1</subject_name>
      <validity><not_before>2020-01-01T00:00:00</not_before><not_after>2036-01-01T00:00:00</not_after></validity>
$(deny "$4")
      <allow_rule>
        <domains><id_range><min>0</min><max>230</max></id_range></domains>
$(topics publish "$2")
$(topics subscribe "$3")
      </allow_rule>
      <default>DENY</default>
    </grant>
  </permissions>
</dds>
XML
}

deny() {
  [ -n "$1" ] || return 0
  echo "      <deny_rule><domains><id_range><min>0</min><max>230</max></id_range></domains>"
  echo "        <publish><topics><topic>$1</topic></topics></publish></deny_rule>"
}

# enclave STORE NAME PUBLISHES SUBSCRIBES [MAY_NOT_PUBLISH]
enclave() {
  local store=$1 name=$2 to=$1/enclaves/$2
  mkdir -p "$to"
  openssl ecparam -name prime256v1 -genkey -noout | openssl pkcs8 -topk8 -nocrypt -out "$to/key.pem"
  openssl req -new -sha256 -key "$to/key.pem" -subj "/CN=\\/$name" |
    openssl x509 -req -sha256 -days 3650 -CA "$store/public/ca.cert.pem" -CAkey "$store/private/ca.key.pem" \
      -CAcreateserial -out "$to/cert.pem"
  cp "$store/public/ca.cert.pem" "$to/identity_ca.cert.pem"
  cp "$store/public/ca.cert.pem" "$to/permissions_ca.cert.pem"
  governance | sign "$store" "$to/governance.p7s"
  permissions "$name" "$3" "$4" "${5:-}" | sign "$store" "$to/permissions.p7s"
}

ours=$1/ours strangers=$1/strangers
certificate_authority "$ours" ours
all='rt/* rq/* rr/*'
enclave "$ours" node "$all" "$all"
enclave "$ours" tools "$all" "$all"
enclave "$ours" narrow "$all" "$all" rt/force_estimate
enclave "$ours" sensor 'rt/displacement rt/coil_current' rt/force_estimate
enclave "$ours" axle 'rt/displacement rt/coil_current' rt/force_estimate
enclave "$ours" deaf 'rt/displacement rt/coil_current' ''
enclave "$ours" mute '' rt/force_estimate
certificate_authority "$strangers" strangers
enclave "$strangers" sensor 'rt/displacement rt/coil_current' rt/force_estimate
