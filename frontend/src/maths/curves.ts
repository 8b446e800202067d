// Curves through nodes [x, y], x not falling: their values and edits. No edit changes the list it is given.

import type { Vector2 } from "../types.ts";

/** [x, y] */
export type Node = Vector2;

/**
 * The limits of edits. step: to which x is rounded, 0 for none; isPinned: the outer nodes keep their x; gap: the least
 * distance of two nodes in x; most: nodes.
 */
export type NodeRules = { x: Vector2; y: Vector2; step: number; isPinned: boolean; gap: number; most: number };

/** The value at x of straight lines between the nodes. */
export function lineAt(nodes: Node[], x: number) {
  const last = nodes.length - 1;
  if (x < nodes[0]![0]) return nodes[0]![1];
  if (x >= nodes[last]![0]) return nodes[last]![1];
  let k = last;
  while (nodes[k]![0] > x) k -= 1;
  const [[x0, y0], [x1, y1]] = [nodes[k]!, nodes[k + 1]!];
  return y0 + ((y1 - y0) * (x - x0)) / (x1 - x0);
}

/**
 * Slopes of Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5 (1984) 300-304): the cubics never leave the nodes' range.
 */
function slopesOf(nodes: Node[]) {
  const n = nodes.length;
  const step: number[] = [];
  const rise: number[] = [];
  for (let k = 0; k + 1 < n; k++) {
    step.push(nodes[k + 1]![0] - nodes[k]![0]);
    rise.push((nodes[k + 1]![1] - nodes[k]![1]) / step[k]!);
  }
  const inner = (k: number) => {
    if (rise[k - 1]! * rise[k]! <= 0) return 0;
    const w1 = 2 * step[k]! + step[k - 1]!,
      w2 = step[k]! + 2 * step[k - 1]!;
    return (w1 + w2) / (w1 / rise[k - 1]! + w2 / rise[k]!);
  };
  const outer = (h0: number, h1: number, d0: number, d1: number) => {
    const d = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
    if (Math.sign(d) !== Math.sign(d0)) return 0;
    return Math.sign(d0) !== Math.sign(d1) && Math.abs(d) > 3 * Math.abs(d0) ? 3 * d0 : d;
  };
  return nodes.map((_, k) => {
    if (k === 0) return outer(step[0]!, step[1]!, rise[0]!, rise[1]!);
    if (k === n - 1) return outer(step[n - 2]!, step[n - 3]!, rise[n - 2]!, rise[n - 3]!);
    return inner(k);
  });
}

/** A function of x: straight lines or monotone cubics through the nodes. */
export function curveThrough(nodes: Node[], isSmooth: boolean = false): (x: number) => number {
  if (!isSmooth || nodes.length < 3) return (x) => lineAt(nodes, x);
  const slopes = slopesOf(nodes),
    last = nodes.length - 1;
  return (x) => {
    if (x <= nodes[0]![0]) return nodes[0]![1];
    if (x >= nodes[last]![0]) return nodes[last]![1];
    let k = last;
    while (nodes[k]![0] > x) k -= 1;
    const [[x0, y0], [x1, y1]] = [nodes[k]!, nodes[k + 1]!],
      h = x1 - x0,
      t = (x - x0) / h,
      s = 1 - t;
    return s * s * (1 + 2 * t) * y0 + t * t * (1 + 2 * s) * y1 + h * t * s * (s * slopes[k]! - t * slopes[k + 1]!);
  };
}

/** A function of x in [0, 1] through values at equal steps. */
export function curveOfSamples(samples: ArrayLike<number>): (x: number) => number {
  const last = samples.length - 1;
  return (x) => {
    const at = Math.max(0, Math.min(1, x)) * last,
      k = Math.min(last - 1, Math.floor(at));
    return samples[k]! + (samples[k + 1]! - samples[k]!) * (at - k);
  };
}

/** Move node k as near to a place as the rules allow. */
export function moveNode(nodes: Node[], k: number, [x, y]: Node, rules: NodeRules) {
  const before = k > 0 ? nodes[k - 1]![0] + rules.gap : rules.x[0];
  const after = k < nodes.length - 1 ? nodes[k + 1]![0] - rules.gap : rules.x[1];
  const rounded = rules.step ? Math.round(x / rules.step) * rules.step : x;
  const isOuter = k === 0 || k === nodes.length - 1,
    stays = (rules.isPinned && isOuter) || before > after;
  const to: Node = [
    stays ? nodes[k]![0] : Math.max(before, Math.min(after, rounded)),
    Math.max(rules.y[0], Math.min(rules.y[1], y)),
  ];
  return nodes.map((node, j) => (j === k ? to : node));
}

/** [nodes, index of the new one], or null where there is no room. */
export function addNode(nodes: Node[], [x, y]: Node, rules: NodeRules): [nodes: Node[], index: number] | null {
  if (nodes.length >= rules.most) return null;
  const rounded = rules.step ? Math.round(x / rules.step) * rules.step : x;
  const at = Math.max(rules.x[0], Math.min(rules.x[1], rounded));
  const index = nodes.findIndex((node) => node[0] > at),
    k = index < 0 ? nodes.length : index;
  const gap = Math.max(rules.gap, 1e-12 * (rules.x[1] - rules.x[0]));
  if (nodes.slice(Math.max(0, k - 1), k + 1).some((node) => Math.abs(node[0] - at) < gap)) return null;
  const node: Node = [at, Math.max(rules.y[0], Math.min(rules.y[1], y))];
  return [[...nodes.slice(0, k), node, ...nodes.slice(k)], k];
}

/** Remove node k; null where it must not be removed. */
export function removeNode(nodes: Node[], k: number, rules: NodeRules) {
  if (nodes.length <= 2 || (rules.isPinned && (k === 0 || k === nodes.length - 1))) return null;
  return nodes.filter((_, j) => j !== k);
}

/** Round numbers in [low, high], about `count` of them. */
export function ticksOf(low: number, high: number, count: number) {
  const rough = (high - low) / Math.max(1, count),
    power = 10 ** Math.floor(Math.log10(rough)),
    found = [];
  const step = [1, 2, 5].map((m) => m * power).find((s) => s >= rough * 0.999) ?? 10 * power;
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step || 0);
  return found;
}

/** A number with as many digits as distinguish values of this range. */
export function formatNumber(value: number, range: number) {
  const digits = Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(range || 1))));
  const text = Math.abs(value) >= 1e6 ? value.toExponential(2) : String(Number(value.toFixed(digits)));
  return text.replace("-", "\u2212");
}
