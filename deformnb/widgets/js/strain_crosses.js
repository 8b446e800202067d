// Crosses of the principal strains at the nodes of the net: solid where matter is stretched, dashed where it is pressed.
// Needs net_places.js and elements.js.

const STRAIN_INKS = { grows: "#7ee08a", shrinks: "#dba6f0" }; // on the grey of a picture, in light and dark pages
const STRAIN_DASH = [3.5, 2.5];

// Arms of all crosses in places of the picture: {gain, arms: [{from, to, grows}]}.
function strainArms(layered, places, cell) {
  const strains = strainsAt(layered, places), gain = strainGain(strains), arms = [];
  for (let n = 0; n < places.isSeen.length; n++) {
    for (const m of [0, 1]) {
      const strain = strains.stretch[2 * n + m] - 1, half = gain * Math.abs(strain) * cell / 2;
      if (!(half > 0.01 * cell)) continue;
      const angle = strains.angle[n] + m * Math.PI / 2, da = half * Math.cos(angle), db = half * Math.sin(angle);
      const [a, b] = [places.target[2 * n], places.target[2 * n + 1]];
      arms.push({ from: [a - da, b - db], to: [a + da, b + db], grows: strain > 0 });
    }
  }
  return { gain, arms };
}

function drawStrain(context, { k, x, y, ratio }, arms) {
  const c = context;
  c.save();
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.lineCap = "butt";
  const trace = (grows) => {
    c.beginPath();
    for (const arm of arms) {
      if (grows !== null && arm.grows !== grows) continue;
      c.moveTo(k * arm.from[0] + x, k * arm.from[1] + y);
      c.lineTo(k * arm.to[0] + x, k * arm.to[1] + y);
    }
    c.stroke();
  };
  Object.assign(c, { strokeStyle: "rgba(0, 0, 0, 0.7)", lineWidth: 4.2 });
  trace(null);
  for (const grows of [false, true]) {
    c.setLineDash(grows ? [] : STRAIN_DASH);
    Object.assign(c, { strokeStyle: STRAIN_INKS[grows ? "grows" : "shrinks"], lineWidth: 2 });
    trace(grows);
  }
  c.restore();
}

// The legend, with an arm of a known strain in the size in which it is drawn; `cell` in CSS pixels.
function strainKey(parent, gain, cell) {
  const share = plainNumber(Math.min(0.5, LONGEST_ARM / gain)), long = share * gain * cell;
  const percent = Number((100 * share).toPrecision(3));
  pageElement("div", "", parent).textContent = "principal strains";
  for (const [grows, word] of [[true, "stretched"], [false, "pressed"]]) {
    const row = pageElement("div", "dnb-ed-key-arm", parent), width = Math.ceil(long) + 2;
    const icon = svgElement("svg", { width, height: 8, viewBox: `0 0 ${width} 8`, "aria-hidden": "true" }, row);
    for (const [stroke, wide] of [["rgba(0, 0, 0, 0.7)", 4.2], [STRAIN_INKS[grows ? "grows" : "shrinks"], 2]]) {
      const dash = wide === 2 && !grows ? { "stroke-dasharray": STRAIN_DASH.join(" ") } : {};
      svgElement("path", { d: `M1 4H${(1 + long).toFixed(1)}`, stroke, "stroke-width": wide, fill: "none", ...dash }, icon);
    }
    pageElement("span", "", row).textContent = `${word} by ${percent} %`;
  }
  const size = gain === 1 ? "in their own size" : `${gain > 1 ? "exaggerated" : "drawn"} \u00d7 ${gain}`;
  pageElement("div", "", parent).textContent = size;
  setAttributes(parent, { "aria-label": `Crosses along the principal strains, ${size}: solid arms are stretched, dashed arms pressed` });
}
