const{periodic,rows}=JSON.parse(document.getElementById("motion").textContent);
const at=id=>document.getElementById(id),first=rows[0],last=rows[rows.length-1],end=last[0];
// A periodic motion goes on from where its last step ends.
const legs=r=>r[8]?[r[3],r[4]]:[r[5],r[6]],other=r=>r[8]?[r[5],r[6]]:[r[3],r[4]];
const step=periodic?other(last)[0]-legs(first)[0]:0,scale=250,low=310;
// What stays in the picture is shown from where one stands; a walk is followed.
const hips=rows.map(r=>r[1]),least=hips.reduce((a,b)=>Math.min(a,b)),most=hips.reduce((a,b)=>Math.max(a,b));
const far=most-least>2,middle=(least+most)/2;
let halted=false,clock=0,before=null;
function row(t){let a=0,b=rows.length-1;while(b-a>1){const m=a+b>>1;rows[m][0]<=t?a=m:b=m}const p=rows[a],q=rows[b];
if(p[8]!==q[8]||q[0]<=p[0])return q[0]<=t?q:p;const s=(t-p[0])/(q[0]-p[0]);return p.map((x,i)=>i===8?x:x+s*(q[i]-x))}
function draw(){const rounds=Math.floor(clock/end),t=periodic?clock-rounds*end:Math.min(clock%(end+1),end);
const r=row(t),shift=periodic?rounds*step:0,eye=periodic||far?r[1]+shift:middle;
const X=x=>430+scale*(x-eye),Y=y=>low-scale*y,set=(id,a)=>{for(const k in a)at(id).setAttribute(k,a[k])};
const hip=[X(r[1]+shift),Y(r[2])];
set("inner",{x1:hip[0],y1:hip[1],x2:X(r[3]+shift),y2:Y(r[4])});set("outer",{x1:hip[0],y1:hip[1],x2:X(r[5]+shift),y2:Y(r[6])});
set("hip",{cx:hip[0],cy:hip[1]});set("body",{x1:hip[0],y1:hip[1],x2:hip[0]+45*Math.sin(r[7]),y2:hip[1]-45*Math.cos(r[7])});
// The floor is drawn where it is and moved as a whole; that of a periodic motion by less than one of its marks.
const at0=periodic?eye-Math.floor(eye*5)/5:eye;set("floor",{transform:"translate("+(430-scale*at0)+" 0)"});
at("clock").textContent=t.toFixed(2)+" s, "+(r[8]?"inner":"outer")+" leg stands"}
function tick(now){if(before!==null&&!halted)clock+=Math.min(.1,(now-before)/1000);before=now;draw();requestAnimationFrame(tick)}
at("walk").addEventListener("click",()=>halted=!halted);draw();requestAnimationFrame(tick);
